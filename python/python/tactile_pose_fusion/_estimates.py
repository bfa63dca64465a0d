"""Estimates as columns."""

from __future__ import annotations

import enum
from collections.abc import ItemsView, Iterator, KeysView, ValuesView
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _core


class Flags(enum.IntFlag):
    """Reasons to trust an estimate less, or not to have one; the bits of `ContactState.msg`."""

    WARMUP = 1
    UNCALIBRATED = 2
    STALE_POSE = 4
    STALE_TACTILE = 8
    POSE_OUT_OF_RANGE = 16
    FAULTY_TAXEL = 32
    NON_FINITE = 64
    LATE = 128
    HELD_POSE = 256
    FROZEN = 512
    INTERLEAVED = 1024
    WRONG_RATE = 2048


class RegionEstimates:
    """The estimates of one region, frame by frame, in the order of time.

    Every column is a NumPy array `[frames]` that can't be written to; it is the memory that the estimates were written to,
    and no copy of it. Where there is no value it is NaN. The object itself is a table for whatever reads Arrow, as in
    `polars.DataFrame(estimates["index"])`; null stands there for NaN.
    """

    def __init__(self, core: _core.Estimates, name: str) -> None:
        self._core = core
        self.name = name

    def _column(self, name: str) -> NDArray[Any]:
        return np.asarray(self._core.column(0, name))

    @cached_property
    def stamp_ns(self) -> NDArray[np.int64]:
        """Stamp of the frame, ns since the epoch."""
        return self._column("stamp_ns")

    @cached_property
    def force_n(self) -> NDArray[np.float64]:
        """Normal force, N; NaN where there is no estimate, and `flags` says why."""
        return self._column("force_n")

    @cached_property
    def tangential_x_n(self) -> NDArray[np.float64]:
        """x of the tangential force in the frame of the patch, N, where the model gives forces of three axes."""
        return self._column("tangential_x_n")

    @cached_property
    def tangential_y_n(self) -> NDArray[np.float64]:
        """y of the tangential force in the frame of the patch, N, where the model gives forces of three axes."""
        return self._column("tangential_y_n")

    @cached_property
    def tangential_z_n(self) -> NDArray[np.float64]:
        """z of the tangential force in the frame of the patch, N, where the model gives forces of three axes."""
        return self._column("tangential_z_n")

    @cached_property
    def base_n(self) -> NDArray[np.float64]:
        """Force of the tactile branch alone, N, where the model gives it."""
        return self._column("base_n")

    @cached_property
    def artifact_n(self) -> NDArray[np.float64]:
        """What the pose correction removed, N: `base_n - force_n`."""
        return self._column("artifact_n")

    @cached_property
    def touch(self) -> NDArray[np.float64]:
        """Probability that something touches the region, where the model gives it."""
        return self._column("touch")

    @cached_property
    def contact(self) -> NDArray[np.bool_]:
        """Whether there is contact, with hysteresis and debounce; held over frames without an estimate."""
        return self._column("contact")

    @cached_property
    def contact_raw(self) -> NDArray[np.bool_]:
        """Whether the frame alone is at or above the threshold of force, or of the probability of touch."""
        return self._column("contact_raw")

    @cached_property
    def event(self) -> NDArray[np.uint8]:
        """1 where contact began in this frame, 2 where it ended, else 0."""
        return self._column("event")

    @cached_property
    def since_ns(self) -> NDArray[np.int64]:
        """Stamp of the first frame of the run that led to the current contact or its absence, ns."""
        return self._column("since_ns")

    @cached_property
    def pose_age_ms(self) -> NDArray[np.float64]:
        """Age of the oldest joint angle of the frame, ms; 0 where all were measured or interpolated."""
        return self._column("pose_age_ms")

    @cached_property
    def adaptation(self) -> NDArray[np.uint8]:
        """What becomes of the artifact: 0 nothing, 1 frozen, 2 learning, 3 waiting, 4 capped, 5 noisy
        joint angles, as in `ContactState.msg`."""
        return self._column("adaptation")

    @cached_property
    def artifact_change(self) -> NDArray[np.float64]:
        """How far the artifact is from its calibration, as a share of it, where it is followed."""
        return self._column("artifact_change")

    @cached_property
    def flags(self) -> NDArray[np.uint32]:
        """Bits of `Flags`."""
        return self._column("flags")

    def __len__(self) -> int:
        return self._core.n_frames(0)

    def __repr__(self) -> str:
        return f"RegionEstimates({self.name!r}, {len(self)} frames)"

    def __arrow_c_schema__(self) -> object:
        return self._core.__arrow_c_schema__()

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        return self._core.__arrow_c_stream__(requested_schema)

    def __arrow_c_array__(self, requested_schema: object | None = None) -> tuple[object, object]:
        return self._core.__arrow_c_array__(requested_schema)


class Estimates:
    """The estimates of all regions, by their names, as in a dictionary.

    It is also a table for whatever reads Arrow, one row a region and frame: `pyarrow.table(estimates)`,
    `polars.DataFrame(estimates)`, `pandas.DataFrame.from_arrow(estimates)`. Its columns are `region`, `stamp` and those of
    `RegionEstimates`, with `since` for `since_ns`.

    Attributes:
        zero: Where the zero of the forces was from, in words; `None` for the estimates of a `Core`.
    """

    def __init__(self, core: _core.Estimates, zero: str | None = None) -> None:
        self._core = core
        self.zero = zero
        self._regions = {
            name: RegionEstimates(core.of_region(idx), name) for idx, name in enumerate(core.regions())
        }

    def __getitem__(self, region: str) -> RegionEstimates:
        return self._regions[region]

    def __iter__(self) -> Iterator[str]:
        return iter(self._regions)

    def __len__(self) -> int:
        return len(self._regions)

    def __contains__(self, region: object) -> bool:
        return region in self._regions

    def keys(self) -> KeysView[str]:
        """Names of the regions, in the order of the parameters."""
        return self._regions.keys()

    def values(self) -> ValuesView[RegionEstimates]:
        """The estimates of each region."""
        return self._regions.values()

    def items(self) -> ItemsView[str, RegionEstimates]:
        """Each region's name and its estimates."""
        return self._regions.items()

    def __repr__(self) -> str:
        return f"Estimates({list(self._regions.values())})"

    def __arrow_c_schema__(self) -> object:
        return self._core.__arrow_c_schema__()

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        return self._core.__arrow_c_stream__(requested_schema)
