"""Policy tick: a streaming bundle against the naive window of K frames, in onnxruntime and in torch, one run.

python benchmarks/policy.py [--ticks 300]

The three answer the same masks in turns, tick by tick, on one thread each, so that whatever else the machine
does meets all of them alike. Weights are random: time does not depend on them.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from adatracker_deploy.learning.checkpoint import OFFLINE_EVT, save_checkpoint
from adatracker_deploy.learning.export import export_checkpoint
from adatracker_deploy.learning.networks import AdaTrackerConfig, ContextEncoder, ContextPolicy
from adatracker_deploy.learning.rollout import walking_masks
from adatracker_deploy.policy.bundle import load_bundle
from adatracker_deploy.policy.drawing import MaskPainter
from adatracker_deploy.policy.onnx_policy import OnnxPolicy

META = OFFLINE_EVT
"""The drawing of 160 to 64 pixels and the two axes fit the default networks."""
WARM_UP_TICKS = 20


class TorchWindow:
    """A training script's inference at test time: it encodes the last K frames anew at every tick."""

    def __init__(self, encoder: ContextEncoder, policy: ContextPolicy) -> None:
        config = encoder.config
        self.encoder, self.policy, self.state = encoder.eval(), policy.eval(), None
        self.masks = torch.zeros(1, config.history, config.channels, config.size, config.size)
        self.actions = torch.zeros(1, config.history, config.actions)

    @torch.inference_mode()
    def step(self, mask):
        z = self.encoder(self.masks, self.actions)
        mask = torch.from_numpy(mask)[None]
        mean, _, self.state = self.policy(mask[:, None], z[:, None], self.state)
        action = torch.tanh(mean[:, 0])
        self.masks = torch.cat((self.masks[:, 1:], mask[:, None]), dim=1)
        self.actions = torch.cat((self.actions[:, 1:], action[:, None]), dim=1)
        return action[0].numpy(), z[0].numpy()


def main() -> None:
    arguments = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    arguments.add_argument("--ticks", type=int, default=300)
    ticks = arguments.parse_args().ticks
    torch.manual_seed(0)
    torch.set_num_threads(1)
    config = AdaTrackerConfig()
    encoder, policy = ContextEncoder(config), ContextPolicy(config)
    masks = walking_masks(META.mask, WARM_UP_TICKS + ticks, seed=0)
    ways = {
        "streaming, onnxruntime": exported(encoder, policy, "streaming").step,
        f"window of {config.history}, onnxruntime": exported(encoder, policy, "window").step,
        f"window of {config.history}, torch": TorchWindow(encoder, policy).step,
    }
    times_ms, answers = race(ways, masks)
    first = next(iter(ways))
    base_ms = np.median(times_ms[first])
    print(f"{ticks} ticks, one thread, ms a tick           median     p99   ratio   differs by at most")
    for name, times in times_ms.items():
        differs = np.abs(answers[name] - answers[first]).max()
        print(
            f"  {name:36}  {np.median(times):8.3f}{np.percentile(times, 99):8.3f}"
            f"{np.median(times) / base_ms:7.1f}x   {differs:.1e}"
        )
    scene = np.random.default_rng(0).integers(0, 4, (480, 640)).astype(np.uint8)
    painted_ms, _ = race({"paint": MaskPainter(META.mask).paint}, [scene] * (WARM_UP_TICKS + ticks))
    print(f"  drawing a 640x480 mask 160 to 64      {np.median(painted_ms['paint']):8.3f}")


def exported(encoder: ContextEncoder, policy: ContextPolicy, interface) -> OnnxPolicy:
    with tempfile.TemporaryDirectory() as folder:
        checkpoint, bundle = Path(folder) / "checkpoint.pt", Path(folder) / "bundle"
        save_checkpoint(checkpoint, encoder, policy, META)
        export_checkpoint(checkpoint, bundle, interface=interface)
        return OnnxPolicy(load_bundle(bundle))


def race(ways: dict[str, Callable], inputs) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return per way the ms a tick took and its first answer at each, warm-up left out."""
    times_ms, answers = {name: [] for name in ways}, {name: [] for name in ways}
    for value in inputs:
        for name, step in ways.items():
            began_ns = time.perf_counter_ns()
            answer = step(value)
            times_ms[name].append((time.perf_counter_ns() - began_ns) / 1e6)
            answers[name].append(answer[0].copy())
    return tuple(
        {name: np.array(values[WARM_UP_TICKS:]) for name, values in kept.items()}
        for kept in (times_ms, answers)
    )


if __name__ == "__main__":
    main()
