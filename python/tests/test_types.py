"""Types hold under mypy's strictest rules, and the stub is what the native module is."""

from __future__ import annotations

import inspect
import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import ROOT, TIMEOUT_S

import tactile_pose_fusion as tpf
from tactile_pose_fusion import _core

PACKAGE = ROOT / "python/python/tactile_pose_fusion"


@pytest.fixture(scope="module")
def mypy(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., None]:
    """Runs mypy, which reads NumPy's types once for all tests."""
    cache = tmp_path_factory.mktemp("mypy")

    def check(*args: object) -> None:
        words = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(cache), *map(str, args)]
        run = subprocess.run(words, capture_output=True, text=True, timeout=TIMEOUT_S, check=False, cwd=ROOT / "python")
        assert run.returncode == 0, run.stdout + run.stderr

    return check


def test_the_package_is_typed(mypy: Callable[..., None]) -> None:
    assert (Path(tpf.__file__).parent / "py.typed").exists()
    mypy(PACKAGE)


def test_a_program_that_uses_it_is_checked(mypy: Callable[..., None], tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(
        "import tactile_pose_fusion as tpf\n"
        "index = tpf.replay('bag', 'glove.yaml')['index']\n"
        "largest: float = float(index.force_n.max())\n"
        "calibrated: tpf.Calibrated = tpf.calibrate(['bag'], 'out.yaml', tpf.Parameters('glove.yaml'))\n"
        "tpf.replay('bag', 'glove.yaml', models='x')  # type: ignore[call-arg]\n"
    )
    mypy("--warn-unused-ignores", program)


def test_the_notebook_and_the_pages_of_the_book_are_checked(mypy: Callable[..., None], tmp_path: Path) -> None:
    notebook = json.loads((ROOT / "python/examples/forces_of_a_bag.ipynb").read_text())
    programs = {"notebook": ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]}
    for page in ("python", "many-bags"):
        text = (ROOT / f"docs/src/how-to/{page}.md").read_text()
        programs[page.replace("-", "_")] = re.findall(r"^```python\n(.*?)^```", text, re.S | re.M)
    for name, blocks in programs.items():
        assert blocks, name
        (tmp_path / f"{name}.py").write_text("\n".join(blocks))
    mypy(*(tmp_path / f"{name}.py" for name in programs))
    # The engines themselves need not be here.
    page = (ROOT / "docs/src/how-to/many-bags.md").read_text()
    for engine in ("dask", "spark"):
        [block] = re.findall(rf"^```python {engine}\n(.*?)^```", page, re.S | re.M)
        (tmp_path / f"{engine}_example.py").write_text("bags = ['a.mcap']\n" + block)
        mypy("--ignore-missing-imports", tmp_path / f"{engine}_example.py")


def test_the_stub_is_what_the_native_module_has(tmp_path: Path) -> None:
    allowed = tmp_path / "allowed"
    allowed.write_text("tactile_pose_fusion._core.__all__\n")  # made by PyO3, of everything
    words = [sys.executable, "-m", "mypy.stubtest", "--ignore-disjoint-bases", "--allowlist", str(allowed)]
    run = subprocess.run([*words, _core.__name__], capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    assert run.returncode == 0, run.stdout + run.stderr


def test_the_stub_names_what_the_native_module_has() -> None:
    stub = (PACKAGE / "_core.pyi").read_text()
    named = set(re.findall(r"^(?:class|def) (\w+)", stub, re.M)) | set(re.findall(r"^(\w+):", stub, re.M))
    there = {name for name in dir(_core) if not name.startswith("_")}
    assert there == {name for name in named if not name.startswith("_")}


def test_everything_public_is_documented() -> None:
    for name in tpf.__all__:
        thing = getattr(tpf, name)
        if inspect.isclass(thing) or inspect.isfunction(thing):
            assert inspect.getdoc(thing), name
