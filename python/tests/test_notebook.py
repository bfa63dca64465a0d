"""The notebook runs as it is, and its numbers are those of the command line, bit by bit."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path
from typing import Any

import nbformat
import pytest
from conftest import ROOT, TIMEOUT_S, tpf_out
from nbclient import NotebookClient

NOTEBOOK = ROOT / "python/examples/forces_of_a_bag.ipynb"


def _texts(cell: Any) -> str:
    return "".join(output["text"] for output in cell.outputs if output.output_type == "stream")


def test_the_notebook_gives_the_numbers_of_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    work = tmp_path / "work"
    work.mkdir()
    shutil.copytree(ROOT / "models", tmp_path / "models")
    shutil.copy(ROOT / "params/glove3.yaml", work)
    # The kernel is this interpreter, and writes nothing into the home of a person.
    for name in ["HOME", "IPYTHONDIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR", "MPLCONFIGDIR"]:
        monkeypatch.setenv(name, str(tmp_path / "home" / name))
    kernel = tmp_path / "home/JUPYTER_DATA_DIR/kernels/python3"
    kernel.mkdir(parents=True)
    argv = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    (kernel / "kernel.json").write_text(json.dumps({"argv": argv, "display_name": "Python 3", "language": "python"}))

    notebook = nbformat.read(NOTEBOOK, as_version=4)
    for cell in notebook.cells:
        assert not cell.get("outputs"), "the notebook is kept without outputs"
    notebook.cells.append(nbformat.v4.new_code_cell("import json\nprint(json.dumps(scores))"))
    NotebookClient(notebook, timeout=TIMEOUT_S, resources={"metadata": {"path": str(work)}}).execute()

    images = [output for cell in notebook.cells for output in cell.get("outputs", []) if "image/png" in output.get("data", {})]
    assert len(images) == 1 and len(images[0].data["image/png"]) > 10_000
    got = json.loads(_texts(notebook.cells[-1]))
    model, baseline = ROOT / "models/glove3_pose_aware.onnx", ROOT / "models/glove3_tactile_only.onnx"
    args = ["--params-file", ROOT / "params/glove3.yaml", "--model", model, "--compare", baseline, "--whole", "--json"]
    expected = json.loads(tpf_out("eval", work / "session", *args))
    assert [one["sha256"] for one in got["models"]] == [one["sha256"] for one in expected["models"]]
    for of_python, of_tpf in zip(got["models"], expected["models"], strict=True):
        assert of_python["by"]["all"] == of_tpf["by"]["all"]
    shown = _texts(notebook.cells[-3])
    assert f"BA {expected['models'][-1]['by']['all'][0]['ba']:.2%}" in shown, shown
