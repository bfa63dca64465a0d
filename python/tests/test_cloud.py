"""Bags and outputs by URI, in a real S3 server on this machine. Runs inside `tests/ros/isolated` alone, where `scripts/s3-server`
made the server: `scripts/cloud-test --python`."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, TIMEOUT_S, run_tpf

import tactile_pose_fusion as tpf
from tactile_pose_fusion import many

SERVER = ROOT / "target/s3-server/bin/s3s-fs"
KEY, SECRET = "AKIATEST", "topsecretkey"
MINUTES = 1.7

#: The cheapest model: what is tested is where it comes from.
MODEL = "glove3_tactile_only.onnx"

pytestmark = [
    pytest.mark.skipif(os.environ.get("TPF_ISOLATED") != "1", reason="not inside tests/ros/isolated"),
    pytest.mark.skipif(
        "TPF_REQUIRE_S3" not in os.environ and not SERVER.exists(), reason="target/s3-server is not here; run scripts/s3-server"
    ),
    pytest.mark.filterwarnings("ignore::tactile_pose_fusion.TactilePoseFusionWarning"),
]


def _settings(port: int) -> dict[str, str]:
    return {"AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}", "AWS_ACCESS_KEY_ID": KEY, "AWS_SECRET_ACCESS_KEY": SECRET}


@pytest.fixture(scope="module")
def objects(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder in which the server keeps the objects of the bucket `bags`, with parameters and a model in it."""
    folder = tmp_path_factory.mktemp("s3")
    for name in ("params", "models"):
        (folder / "bags" / name).mkdir(parents=True)
    shutil.copy(ROOT / "params/glove3.yaml", folder / "bags/params")
    for model in (ROOT / "models").glob("glove3*.onnx"):
        shutil.copy(model, folder / "bags/models")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = [SERVER, "--host", "127.0.0.1", "--port", port, "--access-key", KEY, "--secret-key", SECRET, folder]
    server = subprocess.Popen(list(map(str, words)), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    before = {name: value for name, value in os.environ.items() if name.startswith("AWS_")}
    for name in before:
        del os.environ[name]
    os.environ.update(_settings(port))
    try:
        since = time.monotonic()
        while True:
            try:
                socket.create_connection(("127.0.0.1", port), timeout=5.0).close()
                break
            except OSError:
                assert server.poll() is None and time.monotonic() - since < 30.0, "the S3 server doesn't start"
                time.sleep(0.02)
        yield folder / "bags"
    finally:
        for name in _settings(port):
            os.environ.pop(name, None)
        os.environ.update(before)
        server.kill()
        server.wait()


@pytest.fixture(scope="module")
def sessions(objects: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[list[str], list[str]]:
    """Three sessions as paths and, written to the bucket, as URIs; both with a damaged bag behind them."""
    folder = tmp_path_factory.mktemp("here")
    names = [f"glove3_user0{user}_session1" for user in (1, 2, 3)]
    for user, name in enumerate(names, start=1):
        tpf.simulate(folder / name, glove=3, seed=user, session=1, minutes=MINUTES)
        tpf.simulate(f"s3://bags/bags/{name}", glove=3, seed=user, session=1, minutes=MINUTES)
        assert _files(folder / name) == _files(objects / "bags" / name)
    for broken in (folder / "broken.mcap", objects / "bags/broken.mcap"):
        broken.write_bytes(b"no bag at all, by far")
    names.append("broken.mcap")
    return [str(folder / name) for name in names], [f"s3://bags/bags/{name}" for name in names]


def _files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def _without_places(result: object, bags: list[str]) -> str:
    text = json.dumps(result)
    for place in [*bags, str(ROOT / "models" / MODEL), f"s3://bags/models/{MODEL}"]:
        text = text.replace(place, place.rpartition("/")[2])
    return text


def test_uris_give_what_paths_give(sessions: tuple[list[str], list[str]], objects: Path, params: Path, tmp_path: Path) -> None:
    here, there = sessions
    by_uri = "s3://bags/params/glove3.yaml"
    assert json.dumps(tpf.inspect(here[0])[0]["topics"]) == json.dumps(tpf.inspect(there[0])[0]["topics"])

    ours, theirs = tpf.replay(here[0], params), tpf.replay(there[0], by_uri)
    assert len(ours) > 0 and list(ours) == list(theirs)
    for name in ours:
        np.testing.assert_array_equal(ours[name].force_n, theirs[name].force_n)

    model = ROOT / "models" / MODEL
    local = tpf.evaluate(here[:2], params, model=model, split=None)
    remote = tpf.evaluate(there[:2], by_uri, model=f"s3://bags/models/{MODEL}", split=None)
    assert local["models"] and _without_places(local, here) == _without_places(remote, there)

    tpf.replay_to(here[0], tmp_path / "out.mcap", params)
    tpf.replay_to(there[0], "s3://bags/out.mcap", by_uri)
    assert (tmp_path / "out.mcap").read_bytes() == (objects / "out.mcap").read_bytes()
    tpf.export_lerobot(here[:2], tmp_path / "set", params, fps=20)
    tpf.export_lerobot(there[:2], "s3://bags/set", by_uri, fps=20)
    assert _files(tmp_path / "set") == _files(objects / "set")
    with pytest.raises(tpf.BagError, match="is there already"):
        tpf.replay_to(there[0], "s3://bags/out.mcap", by_uri)


def test_tasks_over_uris_merge_to_what_one_process_gives(sessions: tuple[list[str], list[str]], params: Path) -> None:
    _, there = sessions
    one = run_tpf("eval", *there, "--params-file", params, "--model", ROOT / "models" / MODEL, "--whole", "--json")
    assert one.returncode == 3, one
    file = many.ParamsFile.read("s3://bags/params/glove3.yaml")
    options = {"model": ROOT / "models" / MODEL, "options": ["--whole"]}
    partials: list[bytes | str] = [many.partial([bag], file, **options) for bag in there[1:]]  # type: ignore[arg-type]
    words = ["--params-file", params, "--model", ROOT / "models" / MODEL, "--whole", "--partial", "s3://bags/partials/0.parquet"]
    assert run_tpf("eval", there[0], *words).returncode == 0
    assert many.merge([*partials, "s3://bags/partials/0.parquet"], there) == json.loads(one.stdout)


def test_ray_over_uris_gives_what_one_process_gives(
    sessions: tuple[list[str], list[str]], objects: Path, params: Path, tmp_path: Path
) -> None:
    ray = pytest.importorskip("ray")
    from tactile_pose_fusion import ray as tpf_ray

    _, there = sessions
    model = ROOT / "models" / MODEL
    os.environ["RAY_worker_niceness"] = "0"  # beside other work on this machine they would hardly run
    ray.init(address="local", num_cpus=2, include_dashboard=False, _node_ip_address="127.0.0.1", log_to_driver=False)
    try:
        one = run_tpf("eval", *there, "--params-file", params, "--model", model, "--whole", "--json")
        scores = tpf_ray.evaluate(there, "s3://bags/params/glove3.yaml", model=model, options=["--whole"], progress=False)
        assert scores == json.loads(one.stdout)
        assert [failed["bag"] for failed in scores["failed"]] == there[-1:]
        tpf_ray.replay(there[:2], "s3://bags/many", params, model=model, progress=False)
        words = ["--each", "--params-file", params, "--model", model, "-o", tmp_path / "one"]
        assert run_tpf("replay", *there[:2], *words).returncode == 0
        assert _files(objects / "many") == _files(tmp_path / "one")
        with pytest.raises(ValueError, match="give a path, and copy it"):
            tpf_ray.export(there, Path("s3://bags/joined"), params)
        with pytest.raises(ValueError, match="give a path, and copy them"):
            tpf_ray.evaluate(there, params, partials="s3://bags/kept")
    finally:
        ray.shutdown()


def test_what_a_store_refuses_is_one_line_and_makes_nothing_here(
    objects: Path, bag: Path, params: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    cases = [
        (tpf.BagError, "not found", lambda: tpf.replay("s3://bags/absent.mcap", params)),
        (tpf.BagError, "not found", lambda: tpf.replay(Path("s3://bags/absent.mcap"), params)),
        (tpf.BagError, 'no bucket "none"', lambda: tpf.replay_to(bag, "s3://none/out.mcap", params)),
        (tpf.ParameterError, "not found", lambda: tpf.replay(bag, "s3://bags/absent.yaml")),
        (tpf.ModelError, "not found", lambda: tpf.replay(bag, params, model="s3://bags/absent.onnx")),
        (tpf.CalibrationError, "not found", lambda: tpf.replay(bag, params, calibration="s3://bags/absent.yaml")),
        (tpf.CalibrationError, 'no bucket "none"', lambda: tpf.calibrate(bag, "s3://none/zero.yaml", params)),
        (tpf.TactilePoseFusionError, "on this machine only", lambda: tpf.train(bag, "s3://bags/new.onnx", params)),
        (tpf.BagError, "on this machine only", lambda: tpf.inspect(bag, message_definitions="s3://bags/msgs")),
        (tpf.BagError, "a user, a password", lambda: tpf.inspect("https://me:topsecretkey@127.0.0.1/bag.mcap")),
        (tpf.BagError, "a user, a password", lambda: tpf.inspect("https://127.0.0.1/bag.mcap?sig=topsecretkey")),
        (tpf.BagError, "a user, a password", lambda: tpf.inspect(Path("https://127.0.0.1/bag.mcap?sig=topsecretkey"))),
        (tpf.BagError, "a user, a password", lambda: tpf.inspect(Path("https://me:topsecretkey@127.0.0.1/bag.mcap"))),
    ]
    for idx, (kind, said, call) in enumerate(cases):
        print(f"case {idx}: {said}")  # shown where it fails
        with pytest.raises(tpf.TactilePoseFusionError) as refused:
            call()
        line = str(refused.value)
        assert type(refused.value) is kind and said in line and "\n" not in line and SECRET not in line, refused
    assert list(tmp_path.iterdir()) == []


def test_a_file_uri_is_the_path_that_it_names(bag: Path, params: Path, tmp_path: Path) -> None:
    tpf.replay_to(bag, tmp_path / "a.mcap", params)
    tpf.replay_to(bag.as_uri(), (tmp_path / "b.mcap").as_uri(), params.as_uri())
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    # As pathlib leaves it, with one slash.
    tpf.replay_to(Path(bag.as_uri()), Path((tmp_path / "c.mcap").as_uri()), Path(params.as_uri()))
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "c.mcap").read_bytes()
    model = ROOT / "models" / MODEL
    partial = many.partial([bag.as_uri()], params, model=model, options=["--whole"])
    assert "failed" not in many.merge([partial], [bag.as_uri()])


@pytest.mark.parametrize(
    "what",
    [
        "tpf.inspect('s3://bags/bag.mcap')",
        "tpf.Parameters('s3://bags/params.yaml')",
        "tpf.evaluate(['s3://bags/bag.mcap'], params)",
        "tpf.replay_to(bag, 's3://bags/out.mcap', params)",
    ],
)
def test_sigint_ends_the_wait_for_a_server_that_does_not_answer(what: str, bag: Path, params: Path) -> None:
    # A shell that starts tests in the background lets them ignore the signal.
    code = f"""
import signal
import warnings
import tactile_pose_fusion as tpf
signal.signal(signal.SIGINT, signal.default_int_handler)
warnings.simplefilter("ignore")
bag, params = {str(bag)!r}, {str(params)!r}
try:
    {what}
except KeyboardInterrupt:
    print("interrupted")
"""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        silent.settimeout(TIMEOUT_S)
        settings = os.environ | _settings(silent.getsockname()[1])
        process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=settings)
        try:
            asked, _ = silent.accept()
            asked.recv(1)  # the request is on its way, and no answer will come
            process.send_signal(signal.SIGINT)
            since = time.monotonic()
            said, _ = process.communicate(timeout=TIMEOUT_S)
            assert said == "interrupted\n" and process.returncode == 0
            assert time.monotonic() - since < 5.0
            asked.close()
        finally:
            process.kill()
