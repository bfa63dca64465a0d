"""Estimates in memory are those that `tpf` writes."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from conftest import ROOT, tpf_out

import tactile_pose_fusion as tpf

#: A model that leaves the joints of the parameters out, which a note tells.
TACTILE_ONLY = ROOT / "models/glove3_tactile_only.onnx"


@pytest.mark.parametrize("file", ["glove3.yaml", "glove3 with the adaptive model"])
def test_the_columns_are_those_of_what_tpf_replay_writes(file: str, bag: Path, tmp_path: Path) -> None:
    params = ROOT / "params/glove3.yaml"
    model = ROOT / "models/glove3_adaptive.onnx" if "adaptive" in file else None
    output, table = tmp_path / "forces.mcap", tmp_path / "forces.parquet"
    others = ["--model", model] if model else []
    tpf_out("replay", bag, "--params-file", params, "-o", output, "--merge", *others)
    tpf_out("export", output, "--params-file", params, "--parquet", table)
    expected = pyarrow.parquet.read_table(table)

    with warnings.catch_warnings(record=True):
        estimates = tpf.replay(bag, params, model=model)
    assert list(estimates) == ["index"] and estimates.zero
    index = estimates["index"]
    assert len(index) == expected.num_rows > 10_000

    def column(name: str) -> np.ndarray:
        return expected[name].combine_chunks().to_numpy(zero_copy_only=False)

    assert np.array_equal(index.stamp_ns, column("stamp").astype("datetime64[ns]").astype(np.int64))
    for name in ["force_n", "base_n", "artifact_n", "touch"]:
        got = getattr(index, name)
        assert np.array_equal(got.view(np.int64), column(name).astype(np.float64).view(np.int64)) or np.array_equal(
            got, column(name).astype(np.float64), equal_nan=True
        ), name
    assert np.isnan([index.tangential_x_n, index.tangential_y_n, index.tangential_z_n]).all(), "a model of one axis"
    is_known = ~np.isnan(index.force_n)
    assert is_known.sum() > 10_000
    assert np.array_equal(index.contact[is_known], column("contact")[is_known].astype(bool))
    words = ["|".join(flag.name or "" for flag in sorted(tpf.Flags(int(bits)))) or "none" for bits in index.flags]
    expected_words = ["|".join(sorted(text.split("|"), key=lambda name: _bit(name))) for text in column("flags")]
    assert words == expected_words


def _bit(name: str) -> int:
    return 0 if name == "none" else tpf.Flags[name].value


def test_replay_to_writes_the_bytes_that_tpf_replay_writes(bag: Path, params: Path, tmp_path: Path) -> None:
    tpf_out("replay", bag, "--params-file", params, "-o", tmp_path / "tpf.mcap")
    with warnings.catch_warnings(record=True):
        summary = tpf.replay_to(bag, tmp_path / "python.mcap", params)
    assert (tmp_path / "python.mcap").read_bytes() == (tmp_path / "tpf.mcap").read_bytes()
    assert summary["regions"] and not summary["losses"]


def test_numpy_reads_the_columns_in_place_and_may_not_write(bag: Path, params: Path) -> None:
    with warnings.catch_warnings(record=True):
        index = tpf.replay(bag, params)["index"]
    first, second = np.asarray(index._core.column(0, "force_n")), np.asarray(index._core.column(0, "force_n"))
    assert np.shares_memory(first, second) and np.shares_memory(first, index.force_n)
    with pytest.raises(ValueError):
        index.force_n[0] = 1.0
    forces = index.force_n
    expected = forces.copy()
    del index
    assert np.array_equal(forces, expected, equal_nan=True), "columns outlive what they are from"


def test_notes_are_warnings_of_the_callers_line(bag: Path, params: Path) -> None:
    with pytest.warns(tpf.TactilePoseFusionWarning, match="its model has no pose input") as noted:
        tpf.replay(bag, params, model=TACTILE_ONLY)
    assert {Path(note.filename).name for note in noted} == {Path(__file__).name}


def test_a_warning_that_is_an_error_ends_the_work(bag: Path, params: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", tpf.TactilePoseFusionWarning)
        with pytest.raises(tpf.TactilePoseFusionWarning):
            tpf.replay(bag, params, model=TACTILE_ONLY)


@pytest.mark.filterwarnings("ignore::tactile_pose_fusion.TactilePoseFusionWarning")
def test_progress_is_told_to_a_function_and_what_that_raises_ends_the_work(bag: Path, params: Path) -> None:
    told: list[tuple[int, int]] = []
    tpf.replay(bag, params, progress=lambda done, total: told.append((done, total)))
    assert told and told[-1][0] == told[-1][1] > 0 and told == sorted(told)

    def refuse(done: int, total: int) -> None:
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        tpf.replay(bag, params, progress=refuse)
