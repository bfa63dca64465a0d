"""What the book says of Python runs as it is written."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from conftest import ROOT, TIMEOUT_S


def test_the_page_of_the_book_runs_as_it_is_written(tmp_path: Path) -> None:
    page = (ROOT / "docs/src/how-to/python.md").read_text()
    blocks = re.findall(r"^```python\n(.*?)^```", page, re.S | re.M)
    assert len(blocks) >= 7
    (tmp_path / "work").mkdir()
    shutil.copytree(ROOT / "models", tmp_path / "models")
    shutil.copy(ROOT / "params/glove3.yaml", tmp_path / "work")
    run = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", "\n".join(blocks)],
        cwd=tmp_path / "work",
        env=dict(os.environ),
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    assert run.returncode == 0, run
    assert "frames" in run.stdout and (tmp_path / "work/dataset/meta/info.json").exists()
