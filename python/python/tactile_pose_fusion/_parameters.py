"""Parameter files."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from typing import Union

from . import _core
from ._watch import warn

#: A file or folder, or a URI of one: `s3://`, `gs://`, `az://`, `http(s)://`, `file://`.
Path = Union[str, "os.PathLike[str]"]
#: Recordings: one, or several.
Paths = Union[Path, Sequence[Path]]
#: What a parameter may be set to.
Value = Union[bool, int, float, str, Sequence[bool], Sequence[int], Sequence[float], Sequence[str]]


class Parameters:
    """Topics, taxels, joints, models and thresholds of a glove: a ROS 2 parameter file, read and checked.

    Models and the calibration are found beside the file.

    Args:
        files: The parameter file, or several; a later one overrides those before it.
        set: Single parameters over the files', by key, as in `{"region.index.contact.force_on": 0.03}`.
        node: Full name of the node whose parameters are meant, and whose topics are read and written.
        backend: What runs the models: `auto`, `builtin`, `onnxruntime` or `rten`; `None` for what the files say.

    Raises:
        ParameterError: A file can't be read, or a key or value is refused.
    """

    def __init__(
        self,
        files: Paths,
        *,
        set: Mapping[str, Value] | None = None,
        node: str = "/tactile_pose_fusion",
        backend: str | None = None,
    ) -> None:
        rules = [f"{key}:={json.dumps(value)}" for key, value in (set or {}).items()]
        self._core = _core.Parameters(paths(files), rules, node, backend)
        warn(self._core.notes())

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions, in their order."""
        return tuple(self._core.regions())

    def __repr__(self) -> str:
        return f"Parameters(regions={list(self.regions)})"


def paths(given: Paths) -> list[str]:
    """A list of paths, whether one is given or several."""
    if isinstance(given, (str, os.PathLike)):
        return [place(given)]
    return [place(path) for path in given]


def place(given: Path) -> str:
    """A path or URI as the native half takes it."""
    return _core.place(os.fspath(given))


def optional(given: Path | None) -> str | None:
    """A path, if there is one."""
    return None if given is None else place(given)


def parameters(given: Parameters | Path) -> Parameters:
    """Parameters, read if a file is given."""
    return given if isinstance(given, Parameters) else Parameters(given)


#: When nothing touches the glove: `"all"`, spans as `tpf` takes them such as `"0..10,60..75"`, from and to, or several; in s
#: from the first taxels of each bag.
InAir = Union[str, tuple[float, float], Sequence[tuple[float, float]]]


def in_air_text(given: InAir | None) -> str | None:
    """Spans as `tpf` takes them, if there are some."""
    if given is None or isinstance(given, str):
        return given
    spans = [given] if given and isinstance(given[0], (int, float)) else given
    return ",".join(f"{span[0]}..{span[1]}" for span in spans)  # type: ignore[index]
