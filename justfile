# What people do here. `just` lists it.

default:
    @just --list

# Build the binaries as users run them
build:
    cargo build --release

# Run the tests; those that need ONNX Runtime or Python say so when they skip
test:
    cargo test

# Fetch ONNX Runtime, the Python readers and a browser, then run every test and let none skip for want of them
test-all:
    scripts/fetch-onnxruntime
    scripts/python-venv
    scripts/chromium
    TPF_REQUIRE_ORT=1 TPF_REQUIRE_PYTHON=1 TPF_REQUIRE_BROWSER=1 cargo test

# Build the Python package into target/wheels and run its tests; `just python-test --release` for the wheel as it is released
python-test *args:
    scripts/python-test {{args}}

# Test bags and outputs by URI against a real S3 server on this machine, with faults
cloud-test:
    scripts/cloud-test

# Build the wheel and the sdist of the Python package as they are released, into target/release-wheels, and check them
python-wheel *args:
    scripts/python-wheel {{args}}

# Install that wheel where neither Rust nor a compiler is, use it, and tell how long it took
python-fresh *args:
    scripts/python-fresh {{args}}

# Run many synthetic bags on a real Ray cluster, on Dask and Spark, and as shards, with faults; `just fleet-test --release 1000` for a thousand
fleet-test *args:
    scripts/fleet-test {{args}}

# Run every fuzz target for MINUTES, in bounded memory; an input that breaks something is kept, and how to run it again is told
fuzz minutes="5":
    scripts/fuzz {{minutes}}

# Replay a bag of GB in bounded memory, and tell the peak
big-bag gb="10":
    scripts/big-bag {{gb}}

# Licences, duplicates, sources and known vulnerabilities of what we depend on; the last need the network
deny:
    scripts/cargo-deny check licenses bans sources
    scripts/cargo-deny check advisories

# Test the live node against real ROS 2, in a network namespace of its own
ros-test *distros="kilted jazzy":
    scripts/tmux
    TPF_REQUIRE_ROS=1 tests/ros/test collect
    for distro in {{distros}}; do scripts/ros-venv "$distro" && TPF_REQUIRE_ROS=1 tests/ros/test "$distro" || exit 1; done

# Test the live node on Zenoh, against Zenoh's own Python binding
zenoh-test:
    scripts/ros-venv kilted
    scripts/ros-venv zenoh
    TPF_REQUIRE_ROS=1 tests/ros/test zenoh

# Test the live node in graphs that SROS2 secures, against Fast DDS with its security
security-test:
    scripts/openssl-dev
    scripts/fastdds-peer
    TPF_REQUIRE_ROS=1 tests/ros/test security

# Latency of the node beside a bare echo and a node in rclpy; MODEL as of a synthetic glove: 6 taxels, 4 joints
latency model:
    scripts/ros-venv
    cargo build --release --bins --examples
    tests/ros/isolated target/ros-venv/bin/python tests/ros/latency.py target/release {{model}}

# The live node for MINUTES: 1 kHz, five regions, peers that come, hang and are killed; memory, latency and loss in target/soak
soak minutes="20" model="models/glove1_pose_aware.onnx":
    scripts/ros-venv
    cargo build --release --bins
    tests/ros/isolated target/ros-venv/bin/python tests/ros/soak.py run target/release {{model}} --minutes {{minutes}}

# The same with a node that is stopped every 30 s and a link that stalls every minute: nothing old may be said to be new
trouble minutes="20" model="models/glove1_pose_aware.onnx":
    scripts/ros-venv
    cargo build --release --bins
    tests/ros/isolated target/ros-venv/bin/python tests/ros/soak.py run target/release {{model}} --minutes {{minutes}} --clock grid --trouble --out target/trouble

# The ways in which live inputs go wrong, and what a running node said of each within how many seconds, as a table in OUT
wrong-inputs out="target/wrong_inputs.md":
    scripts/ros-venv
    cargo build --release --bins
    tests/ros/isolated target/ros-venv/bin/python tests/ros/wrong_inputs.py run target/release --out {{out}}

# Formatting and lints, as CI sees them
lint:
    cargo fmt --check
    cargo clippy --all-targets --features zenoh,security -- -D warnings

# Benchmarks: ticks and their tail, replay, training; then replay beside the same work in Python, with a profile of it
bench repetitions="3":
    scripts/fetch-onnxruntime
    scripts/python-venv target/peer-venv benches/peer/requirements.txt
    cargo build --release --bin tpf
    cargo bench --bench replay --bench train
    taskset --cpu-list 0 cargo bench --bench tick
    target/peer-venv/bin/python benches/peer/compare.py target/release/tpf --repetitions {{repetitions}}

# The Python package beside `tpf`, beside the core's own tick and beside pure Python, with the wheel of `just python-wheel`
bench-python *args:
    scripts/python-venv target/peer-venv benches/peer/requirements.txt
    target/peer-venv/bin/pip install --quiet --no-deps --force-reinstall $(ls -t target/release-wheels/*_$(uname -m).whl | head -1)
    target/peer-venv/bin/python benches/peer/package.py {{args}}

# Remake the fixture that holds our network against PyTorch (needs torch from PyPI)
train-fixture:
    python3 tests/python/train_reference.py > tests/data/train_reference.json

# The book, in target/book (needs mdbook: cargo install mdbook) and the API documentation
docs:
    mdbook build docs
    cargo doc --no-deps --open

# Write the generated pages of the book anew
docs-update:
    TPF_UPDATE_DOCS=1 cargo test --test repository docs

# What CI runs
ci:
    .ci/run

# Build this folder with colcon and use what it generates from rclpy
colcon:
    tests/ros/colcon
