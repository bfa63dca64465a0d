"""Functions do what the commands of these names do."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from conftest import ROOT, tpf_out

import tactile_pose_fusion as tpf

pytestmark = pytest.mark.filterwarnings("ignore::tactile_pose_fusion.TactilePoseFusionWarning")


def test_evaluate_gives_what_tpf_eval_prints(bag: Path, params: Path) -> None:
    compare = ROOT / "models/glove3_tactile_only.onnx"
    model = ROOT / "models/glove3_pose_aware.onnx"
    args = ["eval", bag, "--params-file", params, "--model", model, "--compare", compare, "--json"]
    for whole in [True, False]:
        expected = json.loads(tpf_out(*args, *(["--whole"] if whole else [])))
        got = tpf.evaluate(bag, params, model=model, compare=[compare], split=None if whole else "stage")
        for result in (expected, got):
            _without_times(result)
            del result["command"]  # that of the process
        assert got == expected
    assert got["models"][-1]["by"]["all"][0]["ba"] > 0.8


def _without_times(result: object) -> None:
    """Takes out how long inference took, which is another time at every run."""
    if isinstance(result, dict):
        for name in [name for name in result if "latenc" in name or "wall" in name]:
            del result[name]
        for value in result.values():
            _without_times(value)
    elif isinstance(result, list):
        for value in result:
            _without_times(value)


def test_calibrate_writes_the_file_that_tpf_calibrate_writes(bag: Path, params: Path, tmp_path: Path) -> None:
    tpf_out("calibrate", bag, "--params-file", params, "-o", tmp_path / "tpf.yaml", "--touches")
    calibrated = tpf.calibrate(bag, tmp_path / "python.yaml", params, touches="sensor")
    assert (tmp_path / "python.yaml").read_text() == (tmp_path / "tpf.yaml").read_text()
    assert calibrated.zero and calibrated.gains["index"].n_touches >= 3
    gain = calibrated.gains["index"]
    assert gain.low <= gain.gain <= gain.high


def test_characterize_gives_what_tpf_characterize_prints(bag: Path, params: Path) -> None:
    expected = json.loads(tpf_out("characterize", bag, "--params-file", params, "--json"))
    assert tpf.characterize(bag, params) == expected
    assert "joints: [" in expected["parameters"]


def test_spans_in_the_air_and_a_low_true_force_stand_for_annotations(bag: Path, params: Path, tmp_path: Path) -> None:
    by_force = tpf.evaluate(bag, params, split=None, zero_load_below_n=0.1)
    expected = json.loads(tpf_out("eval", bag, "--params-file", params, "--whole", "--zero-load-below", "0.1N", "--json"))
    assert by_force["models"][-1]["by"] == expected["models"][-1]["by"]
    tpf_out("calibrate", bag, "--params-file", params, "-o", tmp_path / "tpf.yaml", "--in-air", "0..10,20..25")
    for name, spans in [("a", [(0.0, 10.0), (20, 25)]), ("b", "0..10,20..25")]:
        tpf.calibrate(bag, tmp_path / name, params, in_air=spans)  # type: ignore[arg-type]
        assert (tmp_path / name).read_text() == (tmp_path / "tpf.yaml").read_text()
    for arguments, line in [
        ({"in_air": (5.0, 2.0)}, "must be before"),
        ({"in_air": "soon"}, "in_air: expected FROM..TO"),
        ({"zero_load_below_n": 0.0}, "zero_load_below_n: expected a force above 0 N"),
        ({"in_air": "all", "zero_load_below_n": 0.1}, "give one"),
    ]:
        with pytest.raises(tpf.ParameterError, match=line):
            tpf.evaluate(bag, params, **arguments)  # type: ignore[arg-type]


def test_exports_are_those_of_tpf_export(bag: Path, params: Path, tmp_path: Path) -> None:
    tpf_out("export", bag, "--params-file", params, "--csv", tmp_path / "tpf.csv", "--lerobot", tmp_path / "tpf")
    tpf.export_tables(bag, params, csv=tmp_path / "python.csv")
    assert (tmp_path / "python.csv").read_bytes() == (tmp_path / "tpf.csv").read_bytes()
    summary = tpf.export_lerobot(bag, tmp_path / "python", params)
    assert summary["bags"][0]["episode"]["frames"] > 1000
    files = {path.relative_to(tmp_path / "tpf") for path in (tmp_path / "tpf").rglob("*") if path.is_file()}
    assert files == {path.relative_to(tmp_path / "python") for path in (tmp_path / "python").rglob("*") if path.is_file()}
    for file in files:
        assert (tmp_path / "python" / file).read_bytes() == (tmp_path / "tpf" / file).read_bytes(), file


def test_simulate_writes_the_bytes_of_tpf_simulate(bag: Path, tmp_path: Path) -> None:
    args = ["--glove", 3, "--users", 1, "--sessions", 3, "--seed", 1, "--minutes", 2.5, "-o", tmp_path]
    tpf_out("simulate", *args)
    [expected] = (tmp_path / bag.name).glob("*.mcap")
    [got] = bag.glob("*.mcap")
    assert got.read_bytes() == expected.read_bytes()
