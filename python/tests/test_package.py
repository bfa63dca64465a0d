"""What is given to people: the sdist has everything that it needs to build, and the metadata is what registries accept."""

from __future__ import annotations

import subprocess
import sys
import tarfile
from pathlib import Path

from conftest import ROOT, TIMEOUT_S, tpf_out

BIN = Path(sys.executable).parent


def run(*words: object, cwd: Path = ROOT) -> str:
    done = subprocess.run(
        [str(word) for word in words], cwd=cwd, capture_output=True, text=True, timeout=TIMEOUT_S, check=False
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return done.stdout


def test_the_sdist_has_every_package_of_its_lock_file(tmp_path: Path) -> None:
    run(BIN / "maturin", "sdist", "--manifest-path", "python/Cargo.toml", "--out", tmp_path)
    [sdist] = tmp_path.glob("*.tar.gz")
    assert "PASSED" in run(sys.executable, "-m", "twine", "check", "--strict", sdist)
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path / "unpacked", filter="data")
    [top] = (tmp_path / "unpacked").iterdir()
    # Cargo refuses here if a path that a manifest names is missing, or if the lock file would have to change.
    platform = ["--filter-platform", "x86_64-unknown-linux-gnu"]
    run("cargo", "metadata", "--locked", "--format-version", "1", *platform, "--manifest-path", "python/Cargo.toml", cwd=top)
    assert (top / "third_party/rustdds/src/lib.rs").exists() and (top / "src/lib.rs").exists()


def test_what_is_installed_fits_together_and_has_its_program() -> None:
    run(sys.executable, "-m", "pip", "check")
    assert tpf_out("--version").startswith("tpf ")
