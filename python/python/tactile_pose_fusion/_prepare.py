"""What comes before forces: what is in a bag, a parameter file for it, a model."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Union

from . import _core
from ._parameters import InAir, Parameters, Path, Paths, in_air_text, optional, parameters, paths, place
from ._watch import Progress, Watcher, warn


def inspect(
    bags: Paths,
    *,
    message_definitions: Path | None = None,
    progress: Progress = True,
) -> list[dict[str, Any]]:
    """Tells what is in bags and models: topics and their timing, which can be taxels, joint angles or force, contracts.

    Args:
        bags: MCAP or `.db3` files, bag folders, or ONNX models. A folder of several recordings gives a report each.
        message_definitions: Folder with the `.msg` files of types that a bag doesn't define.
        progress: Whether to show a bar, or a function of the bytes read and of how many.

    Returns:
        The reports that `tpf inspect --json` prints: `kind` is `"bag"` or `"model"`.

    Raises:
        BagError, ModelError: A path is neither; the line says why.
        KeyboardInterrupt: At Ctrl-C.
    """
    with Watcher("inspect", progress) as watcher:
        reports: list[dict[str, Any]] = json.loads(_core.inspect(paths(bags), optional(message_definitions), watcher))
    return reports


@dataclass(frozen=True)
class Question:
    """What the bags don't tell.

    Attributes:
        text: What is asked.
        options: The answers, at least two.
        likeliest: Index of the likeliest of them.
        reason: Why it is the likeliest.
    """

    text: str
    options: list[str]
    likeliest: int
    reason: str


@dataclass(frozen=True)
class Initialized:
    """A parameter file that was written.

    Attributes:
        path: The file.
        regions: Names of its regions.
        topics: Topics that it reads.
        has_truth: Whether it names a measured force, which training and evaluation need.
    """

    path: str
    regions: list[str]
    topics: list[str]
    has_truth: bool


def init(
    bags: Paths,
    output: Path,
    *,
    model: Path | None = None,
    answer: Callable[[Question], int | None] | None = None,
    message_definitions: Path | None = None,
    overwrite: bool = False,
    progress: Progress = True,
) -> Initialized:
    """Writes a complete parameter file from what is in bags, with a reason for each choice, as `tpf init`.

    Args:
        bags: MCAP or `.db3` files or bag folders of one glove.
        output: The parameter file to write.
        model: Model to use: its taxels, joints and rate decide what the bags leave open.
        answer: Is asked what the bags don't tell, and gives the index of an answer, or `None` for the likeliest. Without
            it the likeliest is taken, with a warning that names it.
        message_definitions: Folder with the `.msg` files of types that a bag doesn't define.
        overwrite: Replace a file that is already there.
        progress: Whether to show a bar, or a function of the bytes read and of how many.

    Returns:
        What is in the file.

    Raises:
        TactilePoseFusionError: The line says what is wrong; nothing is written then.
        KeyboardInterrupt: At Ctrl-C; nothing is written then.
    """

    def asked(text: str, options: list[str], likeliest: int, reason: str) -> int | None:
        assert answer is not None
        return answer(Question(text, options, likeliest, reason))

    with Watcher("inspect", progress) as watcher:
        found, warnings = _core.init(
            paths(bags),
            place(output),
            optional(model),
            None if answer is None else asked,
            optional(message_definitions),
            overwrite,
            watcher,
        )
    warn(warnings)
    regions, topics, has_truth = found
    return Initialized(place(output), regions, topics, has_truth)


@dataclass(frozen=True)
class Trained:
    """A model that was trained.

    Attributes:
        path: The ONNX file.
        report: What is in the report beside it, `NAME.report.json`.
        held_out: With `hold_out`: the scores of each user or donning by the model that was trained without it.
    """

    path: str
    report: dict[str, Any]
    held_out: dict[str, Any] | None


def train(
    bags: Paths,
    output: Path,
    params: Parameters | Path,
    *,
    kind: Literal["pose-aware", "tactile-only", "early-fusion", "adaptive"] = "pose-aware",
    region: Union[str, Sequence[str], None] = None,
    truth: str | None = None,
    steps: int | None = None,
    epochs: float | None = None,
    batch: int | None = None,
    learning_rate: float | None = None,
    light_touches: float | None = None,
    held_touches: int | None = None,
    axes: Literal[1, 3] = 1,
    stride: int = 1,
    seed: int = 0,
    threads: int | None = None,
    lambdas: Union[float, Sequence[float]] = (),
    base_weight: float | None = None,
    offset_gf: float | None = None,
    split: Literal["stage", "session"] = "stage",
    test_share: float = 0.2,
    validation_share: float = 0.08,
    hold_out: Literal["users", "donnings"] | None = None,
    in_air: InAir | None = None,
    zero_load_below_n: float | None = None,
    plain_graph: bool = False,
    resume: bool = False,
    overwrite: bool = False,
    on_validation: Callable[[dict[str, Any]], object] | None = None,
    progress: Progress = True,
) -> Trained:
    """Trains a force model on recordings with a true force and writes it as ONNX with a report beside it, as `tpf train`.

    Args:
        bags: Bags, or folders of bags: one recording each, of one donning of the glove.
        output: The model to write, `NAME.onnx`.
        params: A parameter file, or `Parameters`.
        kind: What to train: `"adaptive"` follows the artifact of pose while the glove is worn, `"pose-aware"` is the
            paper's network, the others are what it is compared with.
        region: Which region of the parameters to train for, where they have several. For `"adaptive"` also several, which
            the model then serves: what pose makes of the taxels is learned for each.
        truth: Topic of the true force instead of the one in the parameters.
        steps: Steps in all; without it 5000, and 20000 for `"adaptive"`.
        epochs: Passes over the training windows, in place of `steps`.
        batch: Windows in a step.
        learning_rate: Largest learning rate.
        light_touches: For `"adaptive"`: share of the windows in the air to which a light touch is added, 0 to 1.
        held_touches: For `"adaptive"`: copies of each session with light touches held in its air and other hand trackers, for a
            network that also gets how far the taxels can be trusted; without it 4, and 0 for one that gets the taxels alone.
        axes: Axes of the model's force: the normal force, or all three where the true force has them; not for `"adaptive"`.
        stride: Frames from one training window to the next.
        seed: The same seed on the same data gives the same model.
        threads: Threads; they change how long it takes and not what comes out.
        lambdas: Weight of the zero-load loss; of several, the model with the smallest validation loss is kept.
        base_weight: Weight of the base force loss.
        offset_gf: What the relative force losses add to the true force in their denominator, gF.
        split: Where sessions are cut into parts for training, validation and test.
        test_share: Share of the time that is kept for the test.
        validation_share: Share of the time that picks the best step; 0 keeps the last step.
        hold_out: Also train a model without each user or donning, and score it on what it never saw.
        in_air: When nothing touches the glove, in s from the first taxels of each bag: `(from, to)`, several of these, or
            `"all"`; instead of annotations.
        zero_load_below_n: The same by the true force, N: nothing touches the glove where it stays below.
        plain_graph: Write the graph layer by layer instead of in the form that runs fastest.
        resume: Go on from the checkpoint that an interrupted run left.
        overwrite: Replace a model that is already there.
        on_validation: Is told of each look at the validation part: a dict with `step`, `loss`, `validation`, `is_best`.
        progress: Whether to show a bar, or a function of the steps done and of how many.

    Returns:
        The model and its report.

    Raises:
        ParameterError, BagError: The line says what is wrong; no model is written then.
        KeyboardInterrupt: At Ctrl-C; `resume=True` goes on from where it was.
    """
    training = {
        "kind": kind,
        "regions": [region] if isinstance(region, str) else list(region or ()),
        "truth": truth,
        "steps": steps,
        "epochs": epochs,
        "batch": batch,
        "learning_rate": learning_rate,
        "light_touches": light_touches,
        "held_touches": held_touches,
        "axes": axes,
        "stride": stride,
        "seed": seed,
        "threads": threads,
        "lambdas": [lambdas] if isinstance(lambdas, (int, float)) else list(lambdas),
        "base_weight": base_weight,
        "offset_gf": offset_gf,
        "split": split,
        "test_share": test_share,
        "validation_share": validation_share,
        "hold_out": hold_out,
        "in_air": in_air_text(in_air),
        "zero_load_below_n": zero_load_below_n,
        "plain_graph": plain_graph,
        "resume": resume,
        "overwrite": overwrite,
    }
    with Watcher("train", progress, on_validation) as watcher:
        report, held_out = _core.train(paths(bags), place(output), parameters(params)._core, training, watcher)
    scores = None if held_out is None else json.loads(held_out)
    return Trained(place(output), json.loads(report), scores)
