"""The native half; `tactile_pose_fusion` wraps it."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, final

import numpy as np
from numpy.typing import NDArray

VERSION: str

def place(given: str) -> str: ...
def is_remote(given: str) -> bool: ...

class TactilePoseFusionError(Exception):
    """Something can't be done; the text is one line that says why and what to do."""

class ParameterError(TactilePoseFusionError):
    """A parameter or an argument is refused."""

class ModelError(TactilePoseFusionError):
    """A model can't be used."""

class BagError(TactilePoseFusionError):
    """A bag can't be read or written."""

class CalibrationError(TactilePoseFusionError):
    """There is no zero to measure forces from: a calibration is refused, or a recording holds none."""

class _Watcher(Protocol):
    def note(self, text: str) -> None: ...
    def progress(self, done: int, total: int) -> None: ...
    def step(self, text: str) -> None: ...

@final
class Column:
    @property
    def __array_interface__(self) -> dict[str, Any]: ...

@final
class Estimates:
    def regions(self) -> list[str]: ...
    def n_frames(self, region_idx: int) -> int: ...
    def column(self, region_idx: int, name: str) -> Column: ...
    def of_region(self, region_idx: int) -> Estimates: ...
    def __arrow_c_schema__(self) -> object: ...
    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object: ...
    def __arrow_c_array__(self, requested_schema: object | None = None) -> tuple[object, object]: ...

@final
class Parameters:
    def __new__(
        cls, files: Sequence[str], overrides: Sequence[str], node: str, backend: str | None
    ) -> Parameters: ...
    def notes(self) -> list[str]: ...
    def regions(self) -> list[str]: ...

@final
class Glove:
    def __new__(cls, parameters: Parameters) -> Glove: ...
    def notes(self) -> list[str]: ...
    def tactile_sources(self) -> list[tuple[str, int]]: ...
    def joint_sources(self) -> list[str]: ...
    def regions(self) -> list[tuple[str, list[str]]]: ...
    def core(self, batch: int) -> Core: ...

@final
class Core:
    def set_baseline(self, median: NDArray[np.float32], source: str | None) -> None: ...
    def load_calibration(self, path: str) -> list[str]: ...
    def feed(
        self,
        taxel_stamps: NDArray[np.int64] | None,
        taxels: NDArray[Any] | None,
        tactile_source: str | None,
        joint_stamps: NDArray[np.int64] | None,
        positions: NDArray[Any] | None,
        joint_names: Sequence[str],
        joint_source: str | None,
    ) -> Estimates: ...
    def finish(self) -> Estimates: ...

def main(args: Sequence[str]) -> int: ...
def try_models_with(program: str, args: Sequence[str]) -> None: ...
def answer_trial(request: str) -> int: ...
def replay(
    bags: Sequence[str],
    parameters: Parameters,
    model: str | None,
    calibration: str | None,
    calibrate_first_s: float | None,
    watcher: _Watcher,
) -> tuple[Estimates, str, list[str]]: ...
def replay_to(
    bags: Sequence[str],
    output: str,
    parameters: Parameters,
    model: str | None,
    calibration: str | None,
    calibrate_first_s: float | None,
    overwrite: bool,
    merge: bool,
    batch: int | None,
    watcher: _Watcher,
) -> tuple[str, list[str]]: ...
def evaluate(
    bags: Sequence[str], parameters: Parameters, scoring: Mapping[str, Any], watcher: _Watcher
) -> tuple[str, list[str]]: ...
def calibrate(
    bags: Sequence[str],
    output: str,
    parameters: Parameters,
    model: str | None,
    calibrate_first_s: float | None,
    by_sensor: bool,
    told: Sequence[tuple[str | None, float, float, float]],
    in_air: str | None,
    zero_load_below_n: float | None,
    watcher: _Watcher,
) -> tuple[str, list[tuple[str, float, float, float, int]]]: ...
def characterize(
    bags: Sequence[str],
    parameters: Parameters,
    in_air: str | None,
    zero_load_below_n: float | None,
    truth: str | None,
    min_gain: float | None,
    calibration: str | None,
    calibrate_first_s: float | None,
    watcher: _Watcher,
) -> tuple[str, list[str]]: ...
def export(
    bags: Sequence[str], parameters: Parameters, wanted: Mapping[str, Any], watcher: _Watcher
) -> tuple[str, list[str]]: ...
def simulate(
    output: str,
    glove: int,
    user: int,
    session: int,
    seed: int,
    minutes: float | None,
    activity: str,
    tracking: str,
    axes: int,
    overwrite: bool,
    watcher: _Watcher,
) -> int: ...
def inspect(paths: Sequence[str], message_definitions: str | None, watcher: _Watcher) -> str: ...
def init(
    bags: Sequence[str],
    output: str,
    model: str | None,
    answer: Callable[[str, list[str], int, str], int | None] | None,
    message_definitions: str | None,
    overwrite: bool,
    watcher: _Watcher,
) -> tuple[tuple[list[str], list[str], bool], list[str]]: ...
def train(
    bags: Sequence[str], output: str, parameters: Parameters, training: Mapping[str, Any], watcher: _Watcher
) -> tuple[str, str | None]: ...
