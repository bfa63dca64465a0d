"""Times a training step of the paper's network in PyTorch on one CPU thread: what `cargo bench --bench train` times here.

Needs torch (CPU).
    python tests/python/train_speed.py [--shards 2] [--seconds 5]
Same shapes, losses, clipping and optimizer, random windows of which half are free of load. Prints one line a case, in
seconds of wall and of CPU a step.
"""

import argparse
import time

import torch
from torch import nn

import train_reference as reference

TAXELS, JOINTS, WINDOW = 16, 4, 64
FORCE_SCALE, TACTILE_SCALE, LAMBDA = 100.0, 0.5, 1.0

# The network takes its shape from the constants of the module that it is in.
reference.TAXELS, reference.JOINTS, reference.TACTILE_SCALE = TAXELS, JOINTS, TACTILE_SCALE


class TactileOnly(nn.Module):
    def __init__(self):
        super().__init__()
        self.conv0 = nn.Conv1d(TAXELS, 64, 3, padding=1)
        self.bn = nn.BatchNorm1d(64)
        self.dilated = nn.ModuleList(nn.Conv1d(64, 64, 3, padding=d, dilation=d) for d in (1, 2, 4))
        self.base = reference.decoder(64, 32, 1)

    def forward(self, tactile):
        x = torch.relu(self.bn(self.conv0(tactile.transpose(1, 2) / TACTILE_SCALE)))
        for conv in self.dilated:
            x = torch.relu(conv(x))
        return self.base(x.amax(2)) * FORCE_SCALE


def relative_error(force, truth):
    return ((force[:, 0] - truth).abs() / (1 + truth.clamp(min=0))).sum()


class Batch:
    def __init__(self, n):
        self.tactile = torch.randn(n, WINDOW, TAXELS)
        self.pose = torch.randn(n, WINDOW, JOINTS)
        self.zero_load = torch.arange(n) % 2 == 0
        self.truth = torch.where(self.zero_load, torch.zeros(n), 100 * torch.rand(n))
        self.target = torch.randn(n, WINDOW, TAXELS)

    def shards(self, n_shards):
        """Parts that are normalized apart, as `TrainConfig::shards` cuts them."""
        columns = (self.tactile, self.pose, self.zero_load, self.truth, self.target)
        return zip(*(column.chunk(n_shards) for column in columns))


def step(net, pose_aware, batch, n_shards, optimizer):
    optimizer.zero_grad(set_to_none=True)
    n, n_free = len(batch.truth), int(batch.zero_load.sum())
    for tactile, pose, zero_load, truth, target in batch.shards(n_shards):
        if pose_aware:
            force, base, artifact = net(tactile, pose)
            loss = (relative_error(force, truth) + relative_error(base, truth)) / n
            change = (artifact - target).abs() * zero_load[:, None, None]
            loss = loss + LAMBDA * change.sum() / (n_free * WINDOW * TAXELS)
        else:
            loss = relative_error(net(tactile), truth) / n
        loss.backward()
    nn.utils.clip_grad_norm_(net.parameters(), 20.0)
    optimizer.step()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--shards", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=5.0)
    args = parser.parse_args()
    torch.manual_seed(0)
    torch.set_num_threads(1)
    torch.set_num_interop_threads(1)
    print(f"torch {torch.__version__}, {torch.get_num_threads()} thread, {args.shards} shards")
    for name, pose_aware in (("pose-aware", True), ("tactile-only", False)):
        for n in (256, 64):
            net = (reference.PoseAware() if pose_aware else TactileOnly()).train()
            optimizer = torch.optim.AdamW(net.parameters(), lr=1e-3, weight_decay=0.01)
            batch = Batch(n)
            for _ in range(3):
                step(net, pose_aware, batch, args.shards, optimizer)
            n_steps, wall, cpu = 0, time.perf_counter(), time.process_time()
            while time.perf_counter() - wall < args.seconds:
                step(net, pose_aware, batch, args.shards, optimizer)
                n_steps += 1
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            print(f"train_step/{name}/batch_{n}: {wall / n_steps:.4f} s, CPU {cpu / n_steps:.4f} s ({n_steps} steps)")


if __name__ == "__main__":
    main()
