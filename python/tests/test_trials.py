"""A model that isn't one of ours is tried in a process of its own: in one, and in no further one."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
import warnings
from pathlib import Path

import pytest
from conftest import ROOT, run_tpf

import tactile_pose_fusion as tpf
from tactile_pose_fusion import _core, _trials

OURS = ROOT / "models/glove3_pose_aware.onnx"

#: Processes that a test may have below it before everything is ended: what starts itself does it at once.
MOST = 16


def varint(number: int) -> bytes:
    more = number >> 7
    return bytes([number & 0x7F | 0x80]) + varint(more) if more else bytes([number])


def field(number: int, value: bytes) -> bytes:
    """A length-delimited field of a protobuf message."""
    return varint(number << 3 | 2) + varint(len(value)) + value


def read_varint(data: bytes, at: int) -> tuple[int, int]:
    number = shift = 0
    while True:
        number |= (data[at] & 0x7F) << shift
        shift, at = shift + 7, at + 1
        if not data[at - 1] & 0x80:
            return number, at


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """The model of a glove with a node beside its network, whose work nobody knows: field 1 of field 7, the graph."""
    data = OURS.read_bytes()
    node = field(1, field(1, b"tactile") + field(2, b"spare") + field(4, b"Identity"))
    at, made = 0, b""
    while at < len(data):
        key, after = read_varint(data, at)
        length, begin = read_varint(data, after) if key & 7 == 2 else (0, read_varint(data, after)[1])
        end = begin + length
        made += field(7, data[begin:end] + node) if key == 7 << 3 | 2 else data[at:end]
        at = end
    path = tmp_path / "foreign.onnx"
    path.write_bytes(made)
    return path


def limited(code: str, timeout: float = 60.0) -> subprocess.CompletedProcess[str]:
    """Runs a program that can't outlive its time, nor what it starts."""
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(code)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        out, err = process.communicate(timeout=timeout)
    finally:
        try:
            os.killpg(process.pid, 9)
        except ProcessLookupError:
            pass
    return subprocess.CompletedProcess(process.args, process.returncode, out, err)


def test_a_foreign_model_is_tried_once_and_the_trial_starts_nothing(foreign: Path, tmp_path: Path) -> None:
    log = tmp_path / "started"
    spy = tmp_path / "python"
    spy.write_text(f'#!/bin/sh\necho started >> "{log}"\n[ $(wc -l < "{log}") -lt {MOST} ] || exit 9\nexec "{sys.executable}" "$@"\n')
    spy.chmod(0o755)
    run = limited(
        f"""
        import sys, warnings
        sys.executable = {str(spy)!r}
        warnings.simplefilter("ignore")
        import tactile_pose_fusion as tpf
        params = tpf.Parameters({str(ROOT / "params/glove3.yaml")!r}, set={{"model.fingertip.path": {str(foreign)!r}}})
        try:
            print(tpf.Glove.load(params).notes)
        except tpf.TactilePoseFusionError as error:
            print(type(error).__name__, error)
        """
    )
    assert run.returncode == 0, run
    assert log.read_text().splitlines() == ["started"], run
    assert "not tried" not in run.stdout and "ended its process" not in run.stdout, run


def test_the_process_of_a_trial_tries_nothing_further(foreign: Path) -> None:
    """Even where a trial process is this package as a whole, which names a program to try models with."""
    run = limited(
        f"""
        import os, sys, warnings
        os.environ["TPF_MODEL_TRIAL"] = "1"
        sys.executable = "/bin/false"  # a process of it is a trial that fails
        warnings.simplefilter("ignore")
        import tactile_pose_fusion as tpf
        from tactile_pose_fusion import _core
        import json
        names = "tactile pose force force_base force_residual touch".split()
        request = {{"path": {str(foreign)!r}, "backend": "Auto", "names": dict(zip(names, names))}}
        print(_core.answer_trial(json.dumps(request)))
        """
    )
    assert (run.returncode, run.stdout) == (0, "0\n"), run


def test_tpf_of_the_wheel_inspects_a_foreign_model_in_seconds(foreign: Path) -> None:
    run = run_tpf("inspect", foreign)
    assert run.returncode == 0 and "ended its process" not in run.stdout + run.stderr, run


def test_the_trial_program_loads_the_native_module_alone() -> None:
    code = _trials._TRIAL.replace("core.answer_trial(request)", "print('numpy' in sys.modules)")
    args = [sys.executable, "-I", "-S", "-c", code, _core.__file__, "--try-model", "{}"]
    run = subprocess.run(args, capture_output=True, text=True, timeout=60, check=False)
    assert run.stdout.strip() == "False", run


def test_what_is_no_model_to_be_run_is_refused() -> None:
    hostile = sorted((ROOT / "tests/data/fuzz/model").glob("*.onnx"))
    assert hostile
    for model in hostile:
        with warnings.catch_warnings(record=True), pytest.raises(tpf.ModelError):
            tpf.Glove.load(tpf.Parameters(ROOT / "params/glove3.yaml", set={"model.fingertip.path": str(model)}))
