"""Notes and progress of long work."""

from __future__ import annotations

import json
import os
import sys
import warnings
from collections.abc import Callable, Iterable
from types import TracebackType
from typing import Any, Union

#: `True` shows a bar of tqdm on a terminal where it is installed, `False` nothing; a function is given how many bytes or
#: steps are done, and of how many.
Progress = Union[bool, Callable[[int, int], object]]

_PACKAGE = os.path.dirname(__file__)


class TactilePoseFusionWarning(UserWarning):
    """Something to know about a result: what is assumed, what was lost of the input."""


def warn(lines: Iterable[str]) -> None:
    """Warns of each line, as of the line of code that called this package."""
    level, frame = 1, sys._getframe()
    while frame is not None and os.path.dirname(frame.f_code.co_filename) == _PACKAGE:
        level, frame = level + 1, frame.f_back  # type: ignore[assignment]
    for line in lines:
        warnings.warn(line, TactilePoseFusionWarning, stacklevel=level)


class Watcher:
    """What the native half tells while it works."""

    def __init__(
        self,
        what: str,
        progress: Progress,
        on_validation: Callable[[dict[str, Any]], object] | None = None,
        *,
        unit: str = "B",
    ) -> None:
        self._what, self._unit = what, unit
        self._on_validation = on_validation
        self._callback = progress if callable(progress) else None
        self._bar: Any = None
        self._tqdm = _tqdm() if progress is True and sys.stderr is not None and sys.stderr.isatty() else None
        self._told: tuple[int, int] | None = None

    def note(self, text: str) -> None:
        warn([text])

    def step(self, text: str) -> None:
        if self._on_validation is not None:
            self._on_validation(json.loads(text))

    def progress(self, done: int, total: int) -> None:
        if self._told == (done, total):
            return
        self._told = (done, total)
        if self._callback is not None:
            self._callback(done, total)
        elif self._tqdm is not None:
            if self._bar is None or self._bar.total != total:
                self._close()
                self._bar = self._tqdm(total=total, desc=self._what, unit=self._unit, unit_scale=self._unit == "B", leave=False)
            self._bar.update(done - self._bar.n)

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    def __enter__(self) -> Watcher:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._close()


def _tqdm() -> Any:
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return None
    return tqdm
