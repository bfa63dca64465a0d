"""What tests share: the repository, a session of a synthetic glove, and the program `tpf` of the wheel."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import tactile_pose_fusion as tpf

ROOT = Path(__file__).resolve().parents[2]

#: What hangs is ended. On a machine that builds something beside, all is many times slower.
TIMEOUT_S = 600


@pytest.fixture(scope="session")
def params() -> Path:
    return ROOT / "params/glove3.yaml"


@pytest.fixture(scope="session")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of the paper's protocol, as short as there is one."""
    path = tmp_path_factory.mktemp("bags") / "glove3_user01_session3"
    n_messages = tpf.simulate(path, glove=3, seed=1, session=3, minutes=2.5)
    assert n_messages > 10_000
    return path


def run_tpf(*args: object) -> subprocess.CompletedProcess[str]:
    """Runs the wheel's `tpf`."""
    program = Path(sys.executable).parent / "tpf"
    words = [str(program), *map(str, args)]
    return subprocess.run(words, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)


def tpf_out(*args: object) -> str:
    """What the wheel's `tpf` prints, when it does all that it is told."""
    run = run_tpf(*args)
    assert run.returncode == 0, run
    return run.stdout
