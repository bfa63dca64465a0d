"""Checks ONNX files with onnx's own checker: python train_onnx_check.py FILE..."""

import sys

import onnx

for path in sys.argv[1:]:
    onnx.checker.check_model(onnx.load(path), full_check=True)
    print("ok", path)
