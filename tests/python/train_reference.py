"""Writes tests/data/train_reference.json: the paper's network, losses and gradients, as PyTorch computes them in float64.

Needs torch (CPU), which the tests don't: the fixture is made once, where torch can be installed.
    python tests/python/train_reference.py > tests/data/train_reference.json
Weights and inputs are numbers of a linear congruential generator that the test runs too, so the file stays small.
"""

import json
import math
import sys

import torch
from torch import nn

WINDOW, TAXELS, JOINTS, N = 64, 6, 4, 5
FORCE_SCALE, TACTILE_SCALE, LAMBDA, SIGMA = 100.0, 0.5, 0.7, 2.0


class Lcg:
    """Knuth's 64-bit linear congruential generator."""

    def __init__(self, seed):
        self.state = seed

    def symmetric(self):
        self.state = (self.state * 6364136223846793005 + 1442695040888963407) % 2**64
        return 2.0 * ((self.state >> 40) / 2**24) - 1.0

    def tensor(self, *shape):
        values = [self.symmetric() for _ in range(math.prod(shape))]
        # float32 first: that is what the other side starts from.
        return torch.tensor(values, dtype=torch.float32).double().reshape(shape)


def decoder(n_in, hidden, n_out):
    return nn.Sequential(nn.Linear(n_in, hidden), nn.ReLU(), nn.Linear(hidden, n_out))


class PoseAware(nn.Module):
    def __init__(self):
        super().__init__()
        self.conv0 = nn.Conv1d(TAXELS, 64, 3, padding=1)
        self.bn = nn.BatchNorm1d(64)
        self.dilated = nn.ModuleList(nn.Conv1d(64, 64, 3, padding=d, dilation=d) for d in (1, 2, 4))
        self.pool = nn.AdaptiveMaxPool1d(1)
        self.base = decoder(64, 32, 1)
        self.ln = nn.LayerNorm(2 * JOINTS)
        self.embed = nn.Linear(2 * JOINTS, 64)
        self.gelu = nn.GELU()
        self.lstm = nn.LSTM(64, 32, num_layers=2, bidirectional=True, batch_first=True)
        self.residual = decoder(192, 64, 1)
        self.auxiliary = decoder(64, 64, TAXELS)

    def forward(self, tactile, pose):
        x = torch.relu(self.bn(self.conv0(tactile.transpose(1, 2) / TACTILE_SCALE)))
        for conv in self.dilated:
            x = torch.relu(conv(x))
        touch = self.pool(x).squeeze(2)
        encoded = torch.cat([pose.sin(), pose.cos()], 2)
        hidden, _ = self.lstm(self.gelu(self.embed(self.ln(encoded))))
        last = hidden[:, -1]
        base = self.base(touch) * FORCE_SCALE
        residual = self.residual(torch.cat([touch, last, touch * last], 1)) * FORCE_SCALE
        return base - residual, base, self.auxiliary(hidden)

    def named(self):
        """Parameters under the names, and in the order, of the other side."""
        yield "tactile.conv0.weight", self.conv0.weight
        yield "tactile.conv0.bias", self.conv0.bias
        yield "tactile.norm.weight", self.bn.weight
        yield "tactile.norm.bias", self.bn.bias
        for idx, conv in enumerate(self.dilated):
            yield f"tactile.conv{idx + 1}.weight", conv.weight
            yield f"tactile.conv{idx + 1}.bias", conv.bias
        yield from self.decoder("base", self.base)
        yield "pose.norm.weight", self.ln.weight
        yield "pose.norm.bias", self.ln.bias
        yield "pose.embed.weight", self.embed.weight
        yield "pose.embed.bias", self.embed.bias
        for layer in range(2):
            for direction, suffix in (("forward", ""), ("backward", "_reverse")):
                for part in ("weight_ih", "weight_hh", "bias_ih", "bias_hh"):
                    yield f"pose.lstm{layer}.{direction}.{part}", getattr(self.lstm, f"{part}_l{layer}{suffix}")
        yield from self.decoder("residual", self.residual)
        yield from self.decoder("auxiliary", self.auxiliary)

    @staticmethod
    def decoder(name, layers):
        for idx, layer in ((0, layers[0]), (1, layers[2])):
            yield f"{name}.{idx}.weight", layer.weight
            yield f"{name}.{idx}.bias", layer.bias


def smoothed_change(window):
    radius = int(4 * SIGMA + 0.5)
    kernel = torch.exp(-0.5 * (torch.arange(-radius, radius + 1).double() / SIGMA) ** 2)
    kernel = kernel / kernel.sum()
    mirrored = torch.cat([window[:radius].flip(0), window, window[-radius:].flip(0)])
    smooth = torch.stack([(kernel[:, None] * mirrored[i : i + 2 * radius + 1]).sum(0) for i in range(len(window))])
    return smooth - smooth[0]


def summary(tensor, probe):
    flat = tensor.reshape(-1)
    return {"first": flat[:6].tolist(), "norm": flat.norm().item(), "dot": (flat * probe.reshape(-1)).sum().item()}


def main():
    net = PoseAware().double()
    lcg = Lcg(7)
    with torch.no_grad():
        for name, parameter in net.named():
            values = lcg.tensor(*parameter.shape)
            if ".norm." in name:
                values = (0.25 * values + (1.0 if name.endswith("weight") else 0.0))
            else:
                values = 0.125 * values
            parameter.copy_(values.float().double())
    tactile, pose = lcg.tensor(N, WINDOW, TAXELS), lcg.tensor(N, WINDOW, JOINTS)
    truth = torch.tensor([0.0, 12.0, 0.5, 80.0, -0.25], dtype=torch.float64)
    zero_load = torch.tensor([True, False, True, False, False])

    net.train()
    force, base, artifact = net(tactile, pose)
    mape = lambda f: ((f[:, 0] - truth).abs() / (1 + truth.clamp(min=0))).mean()
    target = torch.stack([smoothed_change(window) for window in tactile]) / TACTILE_SCALE
    auxiliary = (artifact - target)[zero_load].abs().mean()
    total = mape(force) + mape(base) + LAMBDA * auxiliary
    total.backward()
    out = {
        "torch": torch.__version__,
        "truth": truth.tolist(),
        "force": force[:, 0].tolist(),
        "base": base[:, 0].tolist(),
        "artifact": summary(artifact.transpose(0, 1), lcg.tensor(WINDOW, N, TAXELS)),
        "loss": {"force": mape(force).item(), "base": mape(base).item(), "artifact": auxiliary.item(), "total": total.item()},
        "running_mean": net.bn.running_mean.tolist(),
        "running_var": net.bn.running_var.tolist(),
        "gradients": {name: summary(p.grad, lcg.tensor(*p.shape)) for name, p in net.named()},
    }
    net.eval()
    force, base, _ = net(tactile, pose)
    out["eval_force"], out["eval_base"] = force[:, 0].tolist(), base[:, 0].tolist()
    json.dump(out, sys.stdout, indent=1)
    print()


if __name__ == "__main__":
    main()
