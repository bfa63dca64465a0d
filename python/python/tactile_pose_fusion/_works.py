"""What `tpf` does with bags, as functions."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, Union

from . import _core
from ._estimates import Estimates
from ._parameters import InAir, Parameters, Path, Paths, in_air_text, optional, parameters, paths, place
from ._watch import Progress, Watcher, warn


def replay(
    bags: Paths,
    params: Parameters | Path,
    *,
    model: Path | None = None,
    calibration: Path | None = None,
    calibrate_first_s: float | None = None,
    progress: Progress = True,
) -> Estimates:
    """Takes a recording through the models, and gives the estimates of every frame.

    Args:
        bags: MCAP or `.db3` file or bag folder; several are parts of one recording, merged by time.
        params: A parameter file, or `Parameters`.
        model: Model instead of the only one of the parameters.
        calibration: Calibration file with the zero of the forces; without it annotations of the recording, else the
            calibration of the parameters, else the first seconds.
        calibrate_first_s: Take the zero from the first seconds, in which nothing may touch the glove.
        progress: Whether to show a bar, or a function of the bytes read and of how many.

    Returns:
        The estimates, by region; 100 bytes a frame.

    Raises:
        ParameterError, ModelError, BagError, CalibrationError: The line says what is wrong.
        KeyboardInterrupt: At Ctrl-C.
    """
    with Watcher("replay", progress) as watcher:
        estimates, zero, warnings = _core.replay(
            paths(bags),
            parameters(params)._core,
            optional(model),
            optional(calibration),
            calibrate_first_s,
            watcher,
        )
    warn(warnings)
    return Estimates(estimates, zero)


def replay_to(
    bags: Paths,
    output: Path,
    params: Parameters | Path,
    *,
    model: Path | None = None,
    calibration: Path | None = None,
    calibrate_first_s: float | None = None,
    overwrite: bool = False,
    merge: bool = False,
    batch: int | None = None,
    progress: Progress = True,
) -> dict[str, Any]:
    """Takes a recording through the models, and writes wrench and contact to a new bag, as `tpf replay`.

    Args:
        bags: MCAP or `.db3` file or bag folder; several are parts of one recording, merged by time.
        output: Bag to write: `NAME.mcap` for a file, any other name for a bag folder.
        params: A parameter file, or `Parameters`.
        model: Model instead of the only one of the parameters.
        calibration: Calibration file with the zero of the forces.
        calibrate_first_s: Take the zero from the first seconds, in which nothing may touch the glove.
        overwrite: Replace an output that is already there.
        merge: Copy everything in the input into the output.
        batch: Frames in one inference call, 1 to 4096; with 1 the bytes are those of the live node.
        progress: Whether to show a bar, or a function of the bytes read and of how many.

    Returns:
        The summary that `tpf replay --json` prints.

    Raises:
        ParameterError, ModelError, BagError, CalibrationError: The line says what is wrong; there is no output then.
        KeyboardInterrupt: At Ctrl-C; there is no output then.
    """
    with Watcher("replay", progress) as watcher:
        summary, warnings = _core.replay_to(
            paths(bags),
            place(output),
            parameters(params)._core,
            optional(model),
            optional(calibration),
            calibrate_first_s,
            overwrite,
            merge,
            batch,
            watcher,
        )
    warn(warnings)
    return _object(summary)


def evaluate(
    bags: Paths,
    params: Parameters | Path,
    *,
    model: Path | None = None,
    compare: Sequence[Path] = (),
    split: Literal["stage", "session"] | None = "stage",
    test_share: float = 0.2,
    held_out: bool = False,
    known_touches: int | None = None,
    touch: Union[Literal["force"], float, None] = None,
    truth: str | None = None,
    in_air: InAir | None = None,
    zero_load_below_n: float | None = None,
    calibration: Path | None = None,
    calibrate_first_s: float | None = None,
    jobs: int | None = None,
    progress: Progress = True,
) -> dict[str, Any]:
    """Holds a model, or the estimates in bags, against the true force, as `tpf eval`.

    Args:
        bags: Bags, or folders of bags: one recording each, of one donning of the glove.
        params: A parameter file, or `Parameters`.
        model: The model to judge; `None` for the estimates in the bags where they hold some, else the models of the
            parameters.
        compare: Models to compare it with; the first is the baseline.
        split: Where sessions are cut: the last part of each stage or session, which training doesn't see, is scored.
            `None` scores every frame.
        test_share: Share of the time that is scored.
        held_out: Score each bag by the models `MODEL.without-*.onnx` that were trained without it.
        known_touches: Take the first touches of each session as known, at least 3: they fit a gain of its forces.
        touch: Judge touch by `"force"`, or by this probability of touch; `None` as the node decides contact.
        truth: Topic of the true force instead of the one in the parameters.
        in_air: When nothing touches the glove, in s from the first taxels of each bag: `(from, to)`, several of these, or
            `"all"`; instead of annotations.
        zero_load_below_n: The same by the true force, N: nothing touches the glove where it stays below.
        calibration: Calibration file with the zero of the forces.
        calibrate_first_s: Take the zero from the first seconds, in which nothing may touch the glove.
        jobs: Bags that are read side by side; the result is the same for any number.
        progress: Whether to show a bar, or a function of the bytes read and of how many.

    Returns:
        What `tpf eval --json` prints. Scores of everything are `result["models"][-1]["by"]["all"]`.

    Raises:
        ParameterError, ModelError, BagError, CalibrationError: The line says what is wrong.
        KeyboardInterrupt: At Ctrl-C.
    """
    if known_touches is not None and known_touches < 3:
        raise _core.ParameterError(f"known_touches: expected at least 3, got {known_touches}")
    scoring = {
        "model": optional(model),
        "compare": [place(path) for path in compare],
        "split": split,
        "test_share": test_share,
        "held_out": held_out,
        "known_touches": known_touches,
        "touch": touch if isinstance(touch, (int, float)) else None,
        "touch_by_force": touch == "force",
        "truth": truth,
        "in_air": in_air_text(in_air),
        "zero_load_below_n": zero_load_below_n,
        "calibration": optional(calibration),
        "calibrate_first_s": calibrate_first_s,
        "jobs": jobs,
    }
    with Watcher("evaluate", progress) as watcher:
        result, warnings = _core.evaluate(paths(bags), parameters(params)._core, scoring, watcher)
    warn(warnings)
    return _object(result)


@dataclass(frozen=True)
class KnownTouch:
    """A touch whose force is known from a kitchen scale or a weight.

    Attributes:
        force_n: Its force, N.
        from_s: When it began to be held, s from the begin of the bag.
        to_s: Until when it was held, s.
        region: Where it was; may be left out where there is one region.
    """

    force_n: float
    from_s: float
    to_s: float
    region: str | None = None


@dataclass(frozen=True)
class ForceGain:
    """What the forces of a region are multiplied by in a donning.

    Attributes:
        gain: The factor.
        low: Lower bound of the factor.
        high: Upper bound of the factor.
        n_touches: Touches that it was fitted to.
    """

    gain: float
    low: float
    high: float
    n_touches: int


@dataclass(frozen=True)
class Calibrated:
    """A calibration that was written.

    Attributes:
        path: The file.
        zero: Where the zero is from, in words.
        gains: By region, where touches of a known force were given.
    """

    path: str
    zero: str
    gains: dict[str, ForceGain]


def calibrate(
    bags: Paths,
    output: Path,
    params: Parameters | Path,
    *,
    model: Path | None = None,
    calibrate_first_s: float | None = None,
    touches: Union[Literal["sensor"], Sequence[KnownTouch], None] = None,
    in_air: InAir | None = None,
    zero_load_below_n: float | None = None,
) -> Calibrated:
    """Takes the zero of a recording, checks that the models read no force in it, and keeps it in a file.

    Args:
        bags: MCAP or `.db3` file or bag folder; several are parts of one recording, merged by time.
        output: Calibration file to write.
        params: A parameter file, or `Parameters`.
        model: Model instead of the only one of the parameters.
        calibrate_first_s: Take the zero from the first seconds, in which nothing may touch the glove, instead of
            annotated stretches.
        touches: Also fit what forces are multiplied by: to the touches that the force sensor in the bag measured
            (`"sensor"`), or to these; at least three.
        in_air: When nothing touches the glove, in s from the first taxels of the bag: `(from, to)`, several of these, or
            `"all"`; instead of annotations.
        zero_load_below_n: The same by the true force, N: nothing touches the glove where it stays below.

    Raises:
        ParameterError, ModelError, BagError, CalibrationError: The line says what is wrong; nothing is written then.
        KeyboardInterrupt: At Ctrl-C.
    """
    told = [] if touches is None or touches == "sensor" else [
        (touch.region, touch.force_n, touch.from_s, touch.to_s) for touch in touches if isinstance(touch, KnownTouch)
    ]
    with Watcher("calibrate", False) as watcher:
        zero, gains = _core.calibrate(
            paths(bags),
            place(output),
            parameters(params)._core,
            optional(model),
            calibrate_first_s,
            touches == "sensor",
            told,
            in_air_text(in_air),
            zero_load_below_n,
            watcher,
        )
    return Calibrated(place(output), zero, {gain[0]: ForceGain(gain[1], gain[2], gain[3], gain[4]) for gain in gains})


def characterize(
    bags: Paths,
    params: Parameters | Path,
    *,
    in_air: InAir | None = None,
    zero_load_below_n: float | None = None,
    truth: str | None = None,
    min_gain: float | None = None,
    calibration: Path | None = None,
    calibrate_first_s: float | None = None,
    progress: Progress = True,
) -> dict[str, Any]:
    """Finds which joints move which taxels of a glove, and how large its artifacts are, as `tpf characterize`.

    Args:
        bags: Bags, or folders of bags: one recording each, of one donning of the glove.
        params: A parameter file, or `Parameters`.
        in_air: When nothing touches the glove, in s from the first taxels of each bag: `(from, to)`, several of these, or
            `"all"`; instead of annotations.
        zero_load_below_n: The same by the true force, N: nothing touches the glove where it stays below.
        truth: Topic of the true force instead of the one in the parameters.
        min_gain: Suggest joints as long as each adds this share to what is explained of the artifact.
        calibration: Calibration file with the zero of the taxels.
        calibrate_first_s: Take the zero from the first seconds, in which nothing may touch the glove.
        progress: Whether to show a bar, or a function of the bytes read and of how many.

    Returns:
        What `tpf characterize --json` prints; `result["parameters"]` are lines for the parameter file.

    Raises:
        ParameterError, BagError, CalibrationError: The line says what is wrong.
        KeyboardInterrupt: At Ctrl-C.
    """
    with Watcher("characterize", progress) as watcher:
        result, warnings = _core.characterize(
            paths(bags),
            parameters(params)._core,
            in_air_text(in_air),
            zero_load_below_n,
            truth,
            min_gain,
            optional(calibration),
            calibrate_first_s,
            watcher,
        )
    warn(warnings)
    return _object(result)


def export_lerobot(
    bags: Paths,
    output: Path,
    params: Parameters | Path,
    *,
    fps: int = 30,
    tactile_window_ms: int = 100,
    task: str | None = None,
    model: Path | None = None,
    calibration: Path | None = None,
    calibrate_first_s: float | None = None,
    in_air: InAir | None = None,
    zero_load_below_n: float | None = None,
    progress: Progress = True,
) -> dict[str, Any]:
    """Writes sessions as a LeRobotDataset v3, as `tpf export --lerobot`.

    Args:
        bags: Bags, or folders of bags: one recording each, which becomes one episode.
        output: Folder of the dataset, which must not be there yet.
        params: A parameter file, or `Parameters`.
        fps: Frames a second of the dataset, 1 to 10000.
        tactile_window_ms: How far back the tactile samples of a frame reach, 1 to 10000.
        task: What was done in these bags, in words.
        model: The model that makes estimates; without it those in the bags, else the models of the parameters.
        calibration: Calibration file with the zero of the forces.
        calibrate_first_s: Take the zero from the first seconds, in which nothing may touch the glove.
        in_air: When nothing touches the glove, in s from the first taxels of each bag: `(from, to)`, several of these, or
            `"all"`; instead of annotations.
        zero_load_below_n: The same by the true force, N: nothing touches the glove where it stays below.
        progress: Whether to show a bar, or a function of the bags done and of how many.

    Returns:
        The summary that `tpf export --json` prints.

    Raises:
        TactilePoseFusionError: The line says what is wrong; there is no output then.
        KeyboardInterrupt: At Ctrl-C; there is no output then.
    """
    wanted: dict[str, Any] = {"lerobot": place(output), "parquet": None, "csv": None, "overwrite": False, "truth": None}
    wanted |= {"fps": fps, "tactile_window_ms": tactile_window_ms, "task": task, "model": optional(model)}
    wanted |= {"calibration": optional(calibration), "calibrate_first_s": calibrate_first_s}
    wanted |= {"in_air": in_air_text(in_air), "zero_load_below_n": zero_load_below_n}
    return _export(bags, params, wanted, progress)


def export_tables(
    bags: Paths,
    params: Parameters | Path,
    *,
    parquet: Path | None = None,
    csv: Path | None = None,
    overwrite: bool = False,
    model: Path | None = None,
    truth: str | None = None,
    calibration: Path | None = None,
    calibrate_first_s: float | None = None,
    in_air: InAir | None = None,
    zero_load_below_n: float | None = None,
    progress: Progress = True,
) -> dict[str, Any]:
    """Writes every frame of every region as a table, beside joint angles and the true force, as `tpf export`.

    Args:
        bags: Bags, or folders of bags: one recording each.
        params: A parameter file, or `Parameters`.
        parquet: Parquet file to write.
        csv: CSV file to write.
        overwrite: Replace a table that is already there.
        model: The model that makes estimates; without it those in the bags, else the models of the parameters.
        truth: Topic of the true force instead of the one in the parameters.
        calibration: Calibration file with the zero of the forces.
        calibrate_first_s: Take the zero from the first seconds, in which nothing may touch the glove.
        in_air: When nothing touches the glove, in s from the first taxels of each bag: `(from, to)`, several of these, or
            `"all"`; instead of annotations.
        zero_load_below_n: The same by the true force, N: nothing touches the glove where it stays below.
        progress: Whether to show a bar, or a function of the bags done and of how many.

    Returns:
        The summary that `tpf export --json` prints.

    Raises:
        TactilePoseFusionError: The line says what is wrong; there is no output then.
        KeyboardInterrupt: At Ctrl-C; there is no output then.
    """
    if parquet is None and csv is None:
        raise _core.ParameterError("nothing would be written; give parquet, csv or both")
    wanted: dict[str, Any] = {"lerobot": None, "parquet": optional(parquet), "csv": optional(csv), "overwrite": overwrite}
    wanted |= {"fps": 30, "tactile_window_ms": 100, "task": None, "model": optional(model), "truth": truth}
    wanted |= {"calibration": optional(calibration), "calibrate_first_s": calibrate_first_s}
    wanted |= {"in_air": in_air_text(in_air), "zero_load_below_n": zero_load_below_n}
    return _export(bags, params, wanted, progress)


def _export(bags: Paths, params: Parameters | Path, wanted: dict[str, Any], progress: Progress) -> dict[str, Any]:
    with Watcher("export", progress) as watcher:
        summary, warnings = _core.export(paths(bags), parameters(params)._core, wanted, watcher)
    warn(warnings)
    return _object(summary)


def simulate(
    output: Path,
    *,
    glove: int,
    seed: int,
    user: int = 1,
    session: int = 1,
    minutes: float | None = None,
    activity: Literal["protocol", "manipulation"] = "protocol",
    tracking: Literal["markers", "camera"] = "markers",
    axes: Literal[1, 3] = 1,
    overwrite: bool = False,
    progress: Progress = True,
) -> int:
    """Writes one session of a synthetic glove: taxels, joint angles, true force and annotations. No recording.

    Args:
        output: Bag to write: `NAME.mcap` for a file, any other name for a bag folder.
        glove: 1 capacitive, 2 dull to touch, 3 sensitive with strong artifacts.
        seed: The same seed gives the same bytes; another one has other users.
        user: Number of the user, from 1.
        session: Number of the donning of the glove by this user, from 1.
        minutes: Length; the whole protocol, 27.7 minutes, if not given.
        activity: The paper's protocol, or free manipulation.
        axes: Axes of a taxel: pressure, or x, y and z of the patch, for a hand that also drags on the load cell.
        tracking: Joint angles by markers at 100 Hz, or by a camera at 30 Hz, late and noisy.
        overwrite: Replace an output that is already there.
        progress: Whether to show a bar, or a function of the frames done and of how many.

    Returns:
        The number of messages.

    Raises:
        ParameterError: There is no such session.
        BagError: The bag can't be written.
        KeyboardInterrupt: At Ctrl-C; there is no output then.
    """
    with Watcher("simulate", progress) as watcher:
        return _core.simulate(
            place(output), glove, user, session, seed, minutes, activity, tracking, axes, overwrite, watcher
        )


def _object(text: str) -> dict[str, Any]:
    result: dict[str, Any] = json.loads(text)
    return result
