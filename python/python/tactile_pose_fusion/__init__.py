"""Pose-aware tactile force: taxels and joint angles in, newtons and contact out.

Soft tactile gloves read force when the wearer only bends a finger. This package removes that error in software.

* `replay` takes a recording and gives the estimates of every frame as NumPy arrays, or as a table for pyarrow, polars and
  pandas; `replay_to` writes them to a bag.
* `Glove` and `Core` take samples of your own, one at a time or in blocks.
* `inspect`, `init`, `train`, `evaluate`, `calibrate`, `characterize`, `export_lerobot`, `export_tables` and `simulate` do
  what the commands of `tpf` of these names do.

Where a parameter file is asked for, `Parameters` also says which node is meant and sets single parameters. Long work runs
without the interpreter's lock, can be ended by Ctrl-C, and shows its progress with tqdm where that is installed.
"""

from ._core import (
    BagError,
    CalibrationError,
    ModelError,
    ParameterError,
    TactilePoseFusionError,
)
from ._core import VERSION as __version__
from ._estimates import Estimates, Flags, RegionEstimates
from ._parameters import Parameters
from ._prepare import Initialized, Question, Trained, init, inspect, train
from ._streaming import Core, Glove
from ._trials import try_models_in_processes as _try_models_in_processes
from ._works import (
    Calibrated,
    ForceGain,
    KnownTouch,
    calibrate,
    characterize,
    evaluate,
    export_lerobot,
    export_tables,
    replay,
    replay_to,
    simulate,
)
from ._watch import TactilePoseFusionWarning

__all__ = [
    "BagError",
    "Calibrated",
    "CalibrationError",
    "Core",
    "Estimates",
    "Flags",
    "ForceGain",
    "Glove",
    "Initialized",
    "KnownTouch",
    "ModelError",
    "ParameterError",
    "Parameters",
    "Question",
    "RegionEstimates",
    "TactilePoseFusionError",
    "TactilePoseFusionWarning",
    "Trained",
    "__version__",
    "calibrate",
    "characterize",
    "evaluate",
    "export_lerobot",
    "export_tables",
    "init",
    "inspect",
    "replay",
    "replay_to",
    "simulate",
    "train",
]

_try_models_in_processes()
