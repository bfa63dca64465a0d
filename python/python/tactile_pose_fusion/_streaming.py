"""Samples of your own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _core
from ._estimates import Estimates
from ._parameters import Parameters, Path, parameters, place
from ._watch import warn

#: Stamps in ns since the epoch: one, or `[n]`.
Stamps = Union[int, ArrayLike]


class Glove:
    """A glove as its parameters describe it, with models that can be run.

    Args:
        params: A parameter file, or `Parameters`.

    Raises:
        ParameterError: A parameter is refused.
        ModelError: A model can't be used.
    """

    def __init__(self, params: Parameters | Path) -> None:
        self._core = _core.Glove(parameters(params)._core)

    @classmethod
    def load(cls, params: Parameters | Path) -> Glove:
        """The glove of a parameter file."""
        return cls(params)

    @property
    def notes(self) -> tuple[str, ...]:
        """What to know about its models: what runs each, and what is assumed of it."""
        return tuple(self._core.notes())

    @property
    def regions(self) -> dict[str, tuple[str, ...]]:
        """The joints of each region, by its name."""
        return {name: tuple(joints) for name, joints in self._core.regions()}

    @property
    def tactile_sources(self) -> dict[str, int]:
        """The number of taxels of each tactile source, by its name."""
        return dict(self._core.tactile_sources())

    @property
    def joint_sources(self) -> tuple[str, ...]:
        """Names of the joint sources."""
        return tuple(self._core.joint_sources())

    def core(self, *, batch: int = 1) -> Core:
        """A core that has seen nothing yet. It flags frames UNCALIBRATED until it has a zero.

        Args:
            batch: Frames of one inference call, 1 to 4096. Estimates come once so many are there; they are the same.
        """
        return Core(self._core.core(batch))


class Core:
    """Turns samples of taxels and joint angles into forces. `Glove.core` makes it.

    A frame is estimated as soon as its joint angles are final: when an angle at or after it has come, or when taxels have
    gone on for longer than `timing.joint_slack_ms` of the parameters. So joint angles should come in time, and each call
    gives the estimates that it made possible. Calls from several threads wait for each other.
    """

    def __init__(self, core: _core.Core) -> None:
        self._core = core

    def set_baseline(self, median: ArrayLike, *, source: str | None = None) -> None:
        """Takes what taxels read at rest as their zero.

        Args:
            median: `[taxels]`, in the sensor's own unit.
            source: The tactile source; may be left out where there is one.

        Raises:
            ParameterError: The length isn't that of the source.
        """
        self._core.set_baseline(np.ascontiguousarray(median, dtype=np.float32), source)

    def load_calibration(self, path: Path) -> None:
        """Takes the zero of a file that `calibrate` wrote.

        Raises:
            CalibrationError: It is of another glove, or was judged with another model.
        """
        warn(self._core.load_calibration(place(path)))

    def taxels(self, stamp_ns: Stamps, values: ArrayLike, *, source: str | None = None) -> Estimates:
        """Takes one sample of taxels, or a block of them.

        Args:
            stamp_ns: ns since the epoch: one, or `[n]`, rising.
            values: `[taxels]` or `[n, taxels]`, raw as the sensor sent them.
            source: The tactile source; may be left out where there is one.

        Returns:
            The estimates that are ready now; most often none or one a region.
        """
        stamps = _stamps(stamp_ns)
        return Estimates(self._core.feed(stamps, _rows(values, np.float32, stamps), source, None, None, [], None))

    def joints(
        self, stamp_ns: Stamps, positions: ArrayLike, names: Sequence[str], *, source: str | None = None
    ) -> Estimates:
        """Takes one sample of joint angles, or a block of them. A block must not run ahead of the taxels: see `feed`.

        Args:
            stamp_ns: ns since the epoch: one, or `[n]`, rising.
            positions: `[joints]` or `[n, joints]`, in the unit of the source: rad unless the parameters say degrees.
            names: `[joints]`.
            source: The joint source; may be left out where there is one.

        Returns:
            The estimates that are ready now.
        """
        stamps = _stamps(stamp_ns)
        rows = _rows(positions, np.float64, stamps)
        return Estimates(self._core.feed(None, None, None, stamps, rows, list(names), source))

    def feed(
        self,
        taxel_stamps_ns: ArrayLike,
        taxels: ArrayLike,
        joint_stamps_ns: ArrayLike,
        positions: ArrayLike,
        joint_names: Sequence[str],
        *,
        tactile_source: str | None = None,
        joint_source: str | None = None,
    ) -> Estimates:
        """Takes blocks of taxels and of joint angles, in the order of their stamps: no joint angle is late.

        Args:
            taxel_stamps_ns: `[n]`, ns since the epoch, rising.
            taxels: `[n, taxels]`, raw as the sensor sent them.
            joint_stamps_ns: `[m]`, ns since the epoch, rising.
            positions: `[m, joints]`, in the unit of the source.
            joint_names: `[joints]`.
            tactile_source: The tactile source; may be left out where there is one.
            joint_source: The joint source; may be left out where there is one.

        Returns:
            The estimates that are ready now. The last frames of a block wait for joint angles and come with the next one.
        """
        stamps, joint_stamps = _stamps(taxel_stamps_ns), _stamps(joint_stamps_ns)
        return Estimates(
            self._core.feed(
                stamps,
                _rows(taxels, np.float32, stamps),
                tactile_source,
                joint_stamps,
                _rows(positions, np.float64, joint_stamps),
                list(joint_names),
                joint_source,
            )
        )

    def finish(self) -> Estimates:
        """The estimates of all frames that are left; call it when no more samples come."""
        return Estimates(self._core.finish())


def _stamps(given: Stamps) -> NDArray[np.int64]:
    return np.atleast_1d(np.ascontiguousarray(given, dtype=np.int64))


def _rows(given: ArrayLike, kind: type[np.float32] | type[np.float64], stamps: NDArray[np.int64]) -> NDArray[Any]:
    values: NDArray[Any] = np.ascontiguousarray(given, dtype=kind)
    return values.reshape(1, -1) if values.ndim == 1 and len(stamps) == 1 else values
