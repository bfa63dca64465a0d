"""Writes tests/data/pytorch/parity.*: the paper's network at its full size as PyTorch exports it, and PyTorch's own forces.

Needs torch (CPU), onnx and safetensors, which the tests don't: the files are made once, where torch can be installed.
    python tests/python/parity_reference.py tests/data/pytorch
`parity.onnx` takes 64 frames of 16 taxels and 4 joints. It is written by the TorchScript exporter, opset 17, with a dynamic
batch and no metadata: an exporter that knows nothing of this project. Weights are random numbers of a seed, scaled so that
base and residual are at most 1. `parity.safetensors` holds frames at 100 Hz, and the force and base force of the windows
that they fill, by PyTorch in float32.
"""

import pathlib
import sys

import onnx
import torch
from safetensors.torch import save_file
from torch import nn

WINDOW, TAXELS, JOINTS, FEATURES, FRAMES, SEED = 64, 16, 4, 64, 127, 2


def decoder(n_in, hidden):
    return nn.Sequential(nn.Linear(n_in, hidden), nn.ReLU(), nn.Linear(hidden, 1))


class PoseAware(nn.Module):
    def __init__(self):
        super().__init__()
        self.conv0 = nn.Conv1d(TAXELS, FEATURES, 3, padding=1)
        self.norm = nn.BatchNorm1d(FEATURES)
        self.dilated = nn.ModuleList(nn.Conv1d(FEATURES, FEATURES, 3, padding=d, dilation=d) for d in (1, 2, 4))
        self.base = decoder(FEATURES, 32)
        self.ln = nn.LayerNorm(2 * JOINTS)
        self.embed = nn.Linear(2 * JOINTS, FEATURES)
        self.lstm = nn.LSTM(FEATURES, FEATURES // 2, num_layers=2, bidirectional=True, batch_first=True)
        self.residual = decoder(3 * FEATURES, 64)

    def forward(self, tactile, pose):
        x = torch.relu(self.norm(self.conv0(tactile.transpose(1, 2))))
        for conv in self.dilated:
            x = torch.relu(conv(x))
        touch = x.amax(2)
        encoded = self.ln(torch.cat([pose.sin(), pose.cos()], 2))
        hidden, _ = self.lstm(nn.functional.gelu(self.embed(encoded)))
        last = hidden[:, -1]
        base = self.base(touch)
        residual = self.residual(torch.cat([touch, last, touch * last], 1))
        return base - residual, base, residual


def main():
    folder = pathlib.Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(SEED)
    network = PoseAware()
    nn.init.uniform_(network.norm.running_mean, -0.5, 0.5)
    nn.init.uniform_(network.norm.running_var, 0.5, 2.0)
    network.eval()
    time = torch.arange(FRAMES) / 100.0
    press = 10.0 * torch.exp(-(((time - 0.75) / 0.15) ** 2)) # after the first windows, within the last ones
    tactile = press[:, None] * torch.rand(TAXELS) + 0.2 * torch.randn(FRAMES, TAXELS)
    joints = 0.6 + 0.5 * torch.sin(time[:, None] * (2.0 + torch.arange(JOINTS)))
    tactile, joints = tactile.float(), joints.float()
    starts = range(FRAMES - WINDOW + 1)
    windows = torch.stack([tactile[at : at + WINDOW] for at in starts]), torch.stack([joints[at : at + WINDOW] for at in starts])
    with torch.no_grad():
        for decoder_of, part in [(network.base, 1), (network.residual, 2)]:
            forces = network(*windows)[part]
            decoder_of[2].weight /= forces.abs().max()
            decoder_of[2].bias /= forces.abs().max()
        force, base, _ = network(*windows)
        precise = network.double()(*(part.double() for part in windows))[0]
    print("largest difference to float64:", float((force - precise).abs().max()), "forces from", float(force.min()), "to", float(force.max()), "bases", float(base.min()), float(base.max()))
    names = {"force": force, "force_base": base, "tactile_frames": tactile, "joint_frames": joints}
    save_file({name: value.contiguous() for name, value in names.items()}, folder / "parity.safetensors")
    path = folder / "parity.onnx"
    outputs = ["force", "force_base", "force_residual"]
    axes = {name: {0: "N"} for name in ["tactile", "pose", *outputs]}
    torch.onnx.export(
        network.float(), tuple(part[:2] for part in windows), path, input_names=["tactile", "pose"], output_names=outputs,
        dynamo=False, dynamic_axes=axes, opset_version=17,
    )
    model = onnx.load(path)
    for node in model.graph.node:
        node.ClearField("doc_string") # names the machine
    onnx.save(model, path)


if __name__ == "__main__":
    main()
