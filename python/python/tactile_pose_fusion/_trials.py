"""Processes in which models are tried before they are run here.

A model of another kind than the package's own networks may end the process that runs it. The crate tries it in a process
of its own first. That process loads the native module alone, by its path: neither this package nor anything beside it,
so that it can't start a further one.
"""

import sys

from . import _core

_TRIAL = """
import importlib.machinery, importlib.util, sys
path, request = sys.argv[1], sys.argv[3]
loader = importlib.machinery.ExtensionFileLoader("_core", path)
spec = importlib.util.spec_from_file_location("_core", path, loader=loader)
core = importlib.util.module_from_spec(spec)
loader.exec_module(core)
sys.exit(core.answer_trial(request))
"""


def try_models_in_processes() -> None:
    """From now on models are tried in processes of this interpreter; without one that can be called they are not."""
    path = _core.__file__
    if sys.executable and path:
        _core.try_models_with(sys.executable, ["-I", "-S", "-c", _TRIAL, path])
