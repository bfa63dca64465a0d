"""`python -m tactile_pose_fusion` is `tpf`."""

from ._cli import main

main()
