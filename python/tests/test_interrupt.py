"""Ctrl-C ends long work within seconds, and leaves nothing half written."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import TIMEOUT_S

PROGRAMS = {
    "simulate": "tpf.simulate(out, glove=3, seed=1, progress=told)",
    "replay": "[tpf.replay(bag, params, progress=told) for _ in range(1000)]",
    "replay_to": "[tpf.replay_to(bag, out + '.mcap', params, overwrite=True, progress=told) for _ in range(1000)]",
}


@pytest.mark.parametrize("what", PROGRAMS)
def test_sigint_ends_it_as_a_keyboard_interrupt(what: str, bag: Path, params: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    code = f"""
import warnings
import tactile_pose_fusion as tpf
warnings.simplefilter("ignore")
bag, params, out = {str(bag)!r}, {str(params)!r}, {str(out)!r}
began = False
def told(done, total):
    global began
    if not began:
        began = True
        print("at work", flush=True)
try:
    {PROGRAMS[what]}
except KeyboardInterrupt:
    print("interrupted")
"""
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None and process.stdout.readline() == "at work\n"
        process.send_signal(signal.SIGINT)
        since = time.monotonic()
        said, _ = process.communicate(timeout=TIMEOUT_S)
    finally:
        process.kill()
    assert said == "interrupted\n" and process.returncode == 0
    assert time.monotonic() - since < 10.0
    # What was complete before stays; nothing half written does.
    assert [path for path in tmp_path.iterdir() if path.name != "out.mcap"] == []
