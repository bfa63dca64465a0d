"""Writes tests/data/pytorch/*.onnx: the paper's network, small, as each of PyTorch's two exporters writes it down.

Needs torch (CPU), onnx and onnxscript, which the tests don't: the files are made once, where torch can be installed.
    python tests/python/export_reference.py tests/data/pytorch
Between them the files hold every way to take a window's maximum and every kind of network. What exporters note of the
source code is taken out, as it names the machine.
"""

import pathlib
import sys

import onnx
import torch
from torch import nn

WINDOW, TAXELS, JOINTS, FEATURES = 20, 3, 2, 8


def decoder(n_in, hidden):
    return nn.Sequential(nn.Linear(n_in, hidden), nn.ReLU(), nn.Linear(hidden, 1))


class Network(nn.Module):
    def __init__(self, n_fused):
        super().__init__()
        self.conv0 = nn.Conv1d(TAXELS, FEATURES, 3, padding=1)
        self.bn = nn.BatchNorm1d(FEATURES)
        self.dilated = nn.ModuleList(nn.Conv1d(FEATURES, FEATURES, 3, padding=d, dilation=d) for d in (1, 2, 4))
        self.base = decoder(FEATURES, 5)
        self.ln = nn.LayerNorm(2 * JOINTS)
        self.embed = nn.Linear(2 * JOINTS, FEATURES)
        self.gelu = nn.GELU()
        self.lstm = nn.LSTM(FEATURES, FEATURES // 2, num_layers=2, bidirectional=True, batch_first=True)
        self.fused = decoder(n_fused * FEATURES, 6)

    def channels(self, tactile):
        x = torch.relu(self.bn(self.conv0(tactile.transpose(1, 2))))
        for conv in self.dilated:
            x = torch.relu(conv(x))
        return x

    def posed(self, pose):
        encoded = torch.cat([pose.sin(), pose.cos()], 2)
        hidden, _ = self.lstm(self.gelu(self.embed(self.ln(encoded))))
        return hidden[:, -1]


class PoseAware(Network):
    names = ["force", "force_base", "force_residual"]

    def __init__(self):
        super().__init__(3)
        self.pool = nn.AdaptiveMaxPool1d(1)

    def forward(self, tactile, pose):
        touch = self.pool(self.channels(tactile)).squeeze(2)
        last = self.posed(pose)
        base = self.base(touch)
        residual = self.fused(torch.cat([touch, last, touch * last], 1))
        return base - residual, base, residual


class EarlyFusion(Network):
    names = ["force"]

    def __init__(self):
        super().__init__(2)
        self.pool = nn.MaxPool1d(WINDOW)

    def forward(self, tactile, pose):
        touch = self.pool(self.channels(tactile)).flatten(1)
        return self.fused(torch.cat([touch, self.posed(pose)], 1))


class TactileOnly(Network):
    names = ["force"]

    def __init__(self):
        super().__init__(1)

    def forward(self, tactile):
        return self.base(self.channels(tactile).amax(2))


def export(network, inputs, path, dynamo):
    names = ["tactile", "pose"][: len(inputs)]
    if dynamo:
        shapes = tuple({0: torch.export.Dim("N")} for _ in inputs)
        torch.onnx.export(
            network, inputs, path, input_names=names, output_names=network.names, dynamo=True,
            dynamic_shapes=shapes, external_data=False,
        )
    else:
        axes = {name: {0: "N"} for name in names + network.names}
        torch.onnx.export(
            network, inputs, path, input_names=names, output_names=network.names, dynamo=False,
            dynamic_axes=axes, opset_version=17,
        )
    model = onnx.load(path)
    for node in model.graph.node:
        node.ClearField("metadata_props")
        node.ClearField("doc_string")
    for value in [*model.graph.input, *model.graph.output, *model.graph.value_info, *model.graph.initializer]:
        value.ClearField("metadata_props")
        value.ClearField("doc_string")
    model.graph.ClearField("metadata_props")
    model.ClearField("metadata_props")
    onnx.save(model, path)


def main():
    folder = pathlib.Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name, kind in [("pose_aware", PoseAware), ("early_fusion", EarlyFusion), ("tactile_only", TactileOnly)]:
        torch.manual_seed(1)
        network = kind()
        nn.init.uniform_(network.bn.running_mean, -1.0, 1.0)
        nn.init.uniform_(network.bn.running_var, 0.5, 2.0)
        network.eval()
        inputs = (torch.randn(2, WINDOW, TAXELS), torch.randn(2, WINDOW, JOINTS))
        inputs = inputs[:1] if kind is TactileOnly else inputs
        for exporter, dynamo in [("torchscript", False), ("dynamo", True)]:
            export(network, inputs, folder / f"{exporter}_{name}.onnx", dynamo)


if __name__ == "__main__":
    main()
