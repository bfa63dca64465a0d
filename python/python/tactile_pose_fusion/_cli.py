"""The program `tpf`."""

import signal
import sys

from . import _core
from ._trials import try_models_in_processes


def main() -> None:
    """Runs the command line, as the program `tpf` of the crate does, and leaves with its exit code."""
    try_models_in_processes()
    # Interrupts are the crate's to handle: it takes away what is half written.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    code = _core.main(["tpf", *sys.argv[1:]])
    sys.stdout.flush()
    sys.exit(code)
