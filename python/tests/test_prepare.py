"""`inspect`, `init` and `train` do what the commands of these names do."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, run_tpf, tpf_out

import tactile_pose_fusion as tpf

pytestmark = pytest.mark.filterwarnings("ignore::tactile_pose_fusion.TactilePoseFusionWarning")


def test_inspect_gives_what_tpf_inspect_prints(bag: Path) -> None:
    model = ROOT / "models/glove3_pose_aware.onnx"
    reports = tpf.inspect([bag, model])
    assert reports == json.loads(tpf_out("inspect", bag, model, "--json"))
    assert [report["kind"] for report in reports] == ["bag", "model"]
    assert any(topic["topic"] == "/hand/joint_states" for topic in reports[0]["topics"]), reports[0]["topics"]


def test_inspect_refuses_what_is_neither_in_the_line_of_tpf(tmp_path: Path) -> None:
    for name, kind in [("cut.mcap", tpf.BagError), ("cut.onnx", tpf.ModelError), ("absent", tpf.BagError)]:
        path = tmp_path / name
        if name != "absent":
            path.write_bytes(b"neither")
        with pytest.raises(kind) as raised:
            tpf.inspect(path)
        assert run_tpf("inspect", path).stderr.strip() == f"tpf: {raised.value}"


def test_init_writes_the_file_that_tpf_init_writes(bag: Path, tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    tpf_out("init", bag, "--yes", "-o", tmp_path / "a/glove.yaml")
    with pytest.warns(tpf.TactilePoseFusionWarning, match="guessed"):
        made = tpf.init(bag, tmp_path / "b/glove.yaml")
    assert (tmp_path / "b/glove.yaml").read_text() == (tmp_path / "a/glove.yaml").read_text()
    assert made.has_truth and "/hand/joint_states" in made.topics and made.regions
    with pytest.raises(tpf.TactilePoseFusionError, match="is there already"):
        tpf.init(bag, tmp_path / "b/glove.yaml")
    tpf.init(bag, tmp_path / "b/glove.yaml", overwrite=True)


def test_init_asks_and_what_an_answer_raises_comes_out(bag: Path, tmp_path: Path) -> None:
    asked: list[tpf.Question] = []

    def answer(question: tpf.Question) -> int | None:
        asked.append(question)
        return question.likeliest

    tpf.init(bag, tmp_path / "asked.yaml", answer=answer)
    assert asked and all(len(question.options) >= 2 and question.reason for question in asked)

    def refuse(question: tpf.Question) -> int | None:
        raise LookupError(question.text)

    with pytest.raises(LookupError):
        tpf.init(bag, tmp_path / "refused.yaml", answer=refuse)
    with pytest.raises(tpf.ParameterError, match="answer: expected 0 to"):
        tpf.init(bag, tmp_path / "refused.yaml", answer=lambda question: 99)
    assert not (tmp_path / "refused.yaml").exists()


def test_train_writes_the_model_that_tpf_train_writes(bag: Path, params: Path, tmp_path: Path) -> None:
    args = ["--params-file", params, "--kind", "tactile-only", "--steps", 20, "--stride", 40]
    tpf_out("train", bag, *args, "-o", tmp_path / "tpf.onnx")
    looks: list[dict[str, Any]] = []
    steps: list[tuple[int, int]] = []
    trained = tpf.train(
        bag,
        tmp_path / "python.onnx",
        params,
        kind="tactile-only",
        steps=20,
        stride=40,
        on_validation=looks.append,
        progress=lambda done, total: steps.append((done, total)),
    )
    assert (tmp_path / "python.onnx").read_bytes() == (tmp_path / "tpf.onnx").read_bytes()
    assert trained.report == json.loads((tmp_path / "python.report.json").read_text())
    assert trained.held_out is None
    assert looks and looks[-1]["step"] == 20 and looks[-1]["validation"]["mae_gf"] > 0
    assert steps[-1] == (20, 20)
    report = tpf.replay(bag, params, model=tmp_path / "python.onnx")
    assert len(report["index"]) > 1000


def test_train_refuses_before_it_reads_a_bag(bag: Path, params: Path, tmp_path: Path) -> None:
    output = tmp_path / "model.onnx"
    refused: list[tuple[dict[str, Any], str]] = [
        ({"kind": "best"}, "kind: expected one of pose-aware, tactile-only, early-fusion, adaptive"),
        ({"hold_out": "gloves"}, "hold_out: expected one of users, donnings"),
        ({"split": "bag"}, "split: expected one of stage, session"),
        ({"steps": 5, "epochs": 1.0}, "steps and epochs"),
        ({"region": "toe"}, "toe"),
        ({"light_touches": 0.2}, "light-touches"),
        ({"test_share": 1.5}, "share"),
        ({"batch": 0, "steps": 5, "stride": 40}, "batch"),
        ({"stride": 0}, "stride"),
    ]
    for arguments, line in refused:
        with pytest.raises(tpf.TactilePoseFusionError, match=line):
            tpf.train(bag, output, params, **arguments)
    with pytest.raises(tpf.ParameterError, match="ends with .onnx"):
        tpf.train(bag, tmp_path / "model", params)
    assert list(tmp_path.iterdir()) == []


def test_train_holds_out_each_donning(bag: Path, params: Path, tmp_path: Path) -> None:
    bags = tmp_path / "bags"
    bags.mkdir()
    shutil.copytree(bag, bags / bag.name)
    tpf.simulate(bags / "glove3_user02_session1", glove=3, seed=1, user=2, minutes=2.5)
    trained = tpf.train(
        bags,
        tmp_path / "model.onnx",
        params,
        kind="tactile-only",
        steps=5,
        stride=100,
        hold_out="users",
        progress=False,
    )
    assert trained.held_out is not None and trained.held_out["hold_out"] == "users"
    assert trained.held_out["n_groups"] == 2 and len(trained.held_out["scores"]) >= 2
    assert len(list(tmp_path.glob("model.without-*.onnx"))) == 2


def test_a_model_of_three_axes_is_trained_and_its_tangential_forces_are_columns(tmp_path: Path) -> None:
    bag, params, model = tmp_path / "bag", tmp_path / "shear.yaml", tmp_path / "model.onnx"
    tpf.simulate(bag, glove=1, seed=5, minutes=1.7, axes=3, progress=False)
    page = (ROOT / "docs/src/how-to/three-axes.md").read_text()
    shown = page.split("```yaml\n")[1].split("```")[0]
    params.write_text(shown + "    calibration.max_force: 1000.0\n")  # a model of a few steps reads force in the air
    trained = tpf.train(bag, model, params, axes=3, steps=5, stride=20, progress=False)
    assert trained.report["test"]["final"]["tangential"]["n_frames"] > 100
    index = tpf.replay(bag, params)["index"]
    is_known = ~np.isnan(index.force_n)
    assert is_known.sum() > 5_000
    assert np.array_equal(is_known, ~np.isnan(index.tangential_x_n)) and np.ptp(index.tangential_y_n[is_known]) > 0.0
    wrong: Any = 2
    with pytest.raises(tpf.ParameterError, match="axes: expected 1 or 3, got 2"):
        tpf.train(bag, tmp_path / "other.onnx", params, axes=wrong)
