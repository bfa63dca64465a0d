"""What is refused is refused in the one line of `tpf`, by an exception of its kind."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import ROOT, run_tpf

import tactile_pose_fusion as tpf

pytestmark = pytest.mark.filterwarnings("ignore::tactile_pose_fusion.TactilePoseFusionWarning")


def test_every_error_is_one_line_of_its_kind(bag: Path, params: Path, tmp_path: Path) -> None:
    model = ROOT / "README.md"
    cases = [
        (tpf.ParameterError, lambda: tpf.replay(bag, tmp_path / "absent.yaml")),
        (tpf.ParameterError, lambda: tpf.Parameters(params, set={"region.index.contact.force_on": -1.0})),
        (tpf.ParameterError, lambda: tpf.Parameters(params, backend="abacus")),
        (tpf.ModelError, lambda: tpf.replay(bag, params, model=model)),
        (tpf.ModelError, lambda: tpf.Glove.load(tpf.Parameters(params, set={"model.fingertip.path": str(model)}))),
        (tpf.BagError, lambda: tpf.replay(tmp_path / "absent", params)),
        (tpf.BagError, lambda: tpf.evaluate(tmp_path / "absent", params)),
        (tpf.CalibrationError, lambda: tpf.replay(bag, params, calibration=tmp_path / "absent.yaml")),
        (tpf.ParameterError, lambda: tpf.replay(bag, params, calibrate_first_s=0.0)),
        (tpf.ParameterError, lambda: tpf.simulate(tmp_path / "x", glove=9, seed=1)),
        (tpf.TactilePoseFusionError, lambda: tpf.export_tables(bag, params, csv=tmp_path / "no" / "x.csv")),
    ]
    for kind, call in cases:
        with pytest.raises(tpf.TactilePoseFusionError) as refused:
            call()
        assert type(refused.value) is kind, refused
        assert "\n" not in str(refused.value)
    assert list(tmp_path.iterdir()) == []


def test_the_line_is_that_of_tpf(params: Path, tmp_path: Path) -> None:
    absent = tmp_path / "absent"
    run = run_tpf("replay", absent, "--params-file", params, "-o", tmp_path / "out.mcap")
    with pytest.raises(tpf.BagError) as refused:
        tpf.replay(absent, params)
    assert run.returncode == 1 and run.stderr.strip().splitlines()[-1] == f"tpf: {refused.value}"


def test_the_program_leaves_with_the_exit_codes_of_tpf() -> None:
    version = run_tpf("--version")
    assert (version.returncode, version.stdout.strip()) == (0, f"tpf {tpf.__version__}")
    assert run_tpf("replay").returncode == 2
    assert run_tpf("inspect", "absent").returncode == 1
