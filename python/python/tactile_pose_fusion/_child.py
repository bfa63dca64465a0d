"""`python -m tactile_pose_fusion._child PARENT BYTES WORDS...`: `tpf` as the process of a task.

It ends when its parent does, however that ends: a worker that is killed leaves nothing behind that goes on computing. BYTES
is the most memory that it may have; 0 sets no limit.
"""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import sys

#: `prctl(2)`: the signal that this process gets when its parent ends.
_PR_SET_PDEATHSIG = 1


def main() -> None:
    """Ties this process to its parent, limits its memory, and runs `tpf`."""
    parent, limit = int(sys.argv[1]), int(sys.argv[2])
    del sys.argv[1:3]
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it ended before it could be tied to
        sys.exit("tpf: the worker that began this process is gone")
    if limit > 0:
        resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
        # Where memory ends while Rust prints a backtrace, it waits forever for the lock that it holds itself.
        os.environ["RUST_BACKTRACE"] = "0"
    from ._cli import main as tpf

    tpf()


if __name__ == "__main__":
    main()
