"""The paper's baseline "Online RL": one policy, fine-tuned by reinforcement learning on each body in turn.

The paper cites an asymmetric duelling tracker on RGB and tells no more than "fine-tuned for each embodiment
configuration in a sequential (continual) manner". Here it is recurrent PPO of sb3-contrib (its defaults,
but for the sizes below) on masks instead of RGB, which is kinder to it, over the paper's 16 bodies in the
table's order. Its network is AdaTracker's policy without context, so what it learns is exported like any
other. Needs the `rl` extra.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from sb3_contrib import RecurrentPPO
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import DummyVecEnv
from torch import Tensor, nn

from adatracker_deploy.config.schema import Range
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.checkpoint import ADATRACKER_MASK, CheckpointMeta, save_checkpoint
from adatracker_deploy.learning.conditions import HEIGHTS_M, TARGET_SPEEDS_M_S
from adatracker_deploy.learning.drivers import Actor
from adatracker_deploy.learning.environment import TrackingEnv
from adatracker_deploy.learning.episode_spec import RATE_HZ
from adatracker_deploy.learning.networks import AdaTrackerConfig, Backbone, ContextPolicy
from adatracker_deploy.learning.tracking import ACTION
from adatracker_deploy.learning.train.agent import drawn

BODIES = tuple((height_m, speed_m_s) for height_m in HEIGHTS_M for speed_m_s in TARGET_SPEEDS_M_S)
CONFIG = AdaTrackerConfig(history=0, context=0)
POLICY_NAME = "policy.pt"

_ENVS = 8
_STEPS = 128
"""Steps of each environment per update; with 8 environments, 1,024 in all."""
_BATCH = 256


@dataclass(frozen=True, slots=True, kw_only=True)
class OnlineSettings:
    """One run."""

    condition: str = "clean"
    steps: Annotated[int, Range(1, 1_000_000_000)] = 50_000
    """With each body, rounded up to whole updates of 1,024."""
    seed: Annotated[int, Range(0, 1 << 20)] = 0


def train_online(settings: OnlineSettings, out: Path, say: Callable[[str], None]) -> Path:
    """Fine-tune on one body after the other and return the checkpoint; what is finished is gone on from.

    Args:
        settings: of the run.
        out: a folder; after each body the learner's state is saved there.
        say: called with a line for each body, and its result.

    Raises:
        UsageError: the folder cannot be made, or there is no such condition.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{out}: cannot be made: {error}") from error
    stages = [out / f"body-{number:02d}.zip" for number in range(len(BODIES))]
    done = next((number for number, stage in enumerate(stages) if not stage.exists()), len(stages))
    model = _learner(settings, stages[done - 1] if done else None)
    for number in range(done, len(BODIES)):
        height_m, speed_m_s = BODIES[number]
        model.set_env(_environments(settings.condition, height_m, speed_m_s))
        model.learn(settings.steps, reset_num_timesteps=False)
        reward = np.mean([episode["r"] for episode in model.ep_info_buffer or [{"r": np.nan}]])
        say(f"body {number + 1} of {len(BODIES)}, {height_m:g} m, {speed_m_s:g} m/s: AR {reward:.0f}")
        model.save(stages[number])
    meta = CheckpointMeta(
        name="online_rl",
        mask=ADATRACKER_MASK,
        action=ACTION,
        rate_hz=RATE_HZ,
        training=f"recurrent PPO on 16 bodies in turn, {settings.steps} steps each, seed {settings.seed}",
        licence="Apache-2.0",
    )
    save_checkpoint(out / POLICY_NAME, None, as_policy(model), meta)
    return out / POLICY_NAME


def as_policy(model: RecurrentPPO) -> ContextPolicy:
    """Return the actor as AdaTracker's policy; it answers with tanh of the Gaussian's mean."""
    learnt: Any = model.policy  # its modules are made at run time, by the arguments in `_learner`
    policy = ContextPolicy(CONFIG)
    policy.backbone.load_state_dict(learnt.features_extractor.backbone.state_dict())
    policy.memory.load_state_dict(learnt.lstm_actor.state_dict())
    actor = policy.actor
    assert isinstance(actor, Actor)  # as CONFIG says
    actor.hidden.load_state_dict(learnt.mlp_extractor.policy_net[0].state_dict())
    actor.mean.load_state_dict(learnt.action_net.state_dict())
    with torch.no_grad():
        actor.log_std.weight.zero_()
        actor.log_std.bias.copy_(learnt.log_std)
    return policy


class Squashed(gymnasium.ActionWrapper[Any, NDArray[np.float32], NDArray[np.float32]]):
    """Takes actions before tanh: PPO's Gaussian is unbounded, a bundle's action is not."""

    def __init__(self, env: TrackingEnv) -> None:
        super().__init__(env)
        self.action_space = spaces.Box(-5.0, 5.0, (2,), np.float32)

    def action(self, action: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the fractions of the body's limits."""
        return np.tanh(action)


class Features(BaseFeaturesExtractor):
    """The backbone on class masks (N, 64, 64), which arrive as floats."""

    def __init__(self, space: spaces.Box, config: AdaTrackerConfig) -> None:
        super().__init__(space, config.features)
        self.backbone = Backbone(config)

    def forward(self, classes: Tensor) -> Tensor:
        """Return (N, features)."""
        features: Tensor = self.backbone(drawn(classes))
        return features


def _learner(settings: OnlineSettings, saved: Path | None) -> RecurrentPPO:
    if saved is not None:
        return RecurrentPPO.load(saved)
    return RecurrentPPO(
        "MlpLstmPolicy",
        _environments(settings.condition, *BODIES[0]),
        n_steps=_STEPS,
        batch_size=_BATCH,
        seed=settings.seed,
        policy_kwargs={
            "features_extractor_class": Features,
            "features_extractor_kwargs": {"config": CONFIG},
            "lstm_hidden_size": CONFIG.hidden,
            "net_arch": {"pi": [CONFIG.actor], "vf": [CONFIG.actor]},
            "activation_fn": nn.ReLU,
        },
    )


def _environments(condition: str, height_m: float, speed_m_s: float) -> DummyVecEnv:
    from stable_baselines3.common.monitor import Monitor

    def make() -> gymnasium.Env[Any, Any]:
        env = TrackingEnv(condition=condition, height_m=height_m, target_speed_m_s=speed_m_s)
        return Monitor(Squashed(env))

    return DummyVecEnv([make] * _ENVS)
