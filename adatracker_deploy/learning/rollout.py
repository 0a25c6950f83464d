"""Reference rollout of a policy in torch, with a whole window per tick; exports must match it."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from adatracker_deploy.core.messages import ClassMask, MaskClass
from adatracker_deploy.learning.checkpoint import AdaTracker, Checkpoint, OfflineEvt
from adatracker_deploy.learning.drivers import LstmState
from adatracker_deploy.policy import belief
from adatracker_deploy.policy.belief import Array
from adatracker_deploy.policy.drawing import MaskPainter
from adatracker_deploy.policy.golden import Golden
from adatracker_deploy.policy.manifest import MaskSpec
from adatracker_deploy.policy.past import Past
from adatracker_deploy.policy.search import with_search


def rollout(checkpoint: Checkpoint, masks: NDArray[np.float32]) -> Golden:
    """Return a policy's answers from reset, its own actions fed back.

    Args:
        checkpoint: networks in evaluation mode.
        masks: network inputs, (T, C, S, S).

    Returns:
        mask (the masks given), action (T, A), z (T, Z) with an encoder, belief (T, `belief.SIZE`) with one.
    """
    answers = {"mask": masks}
    with torch.no_grad():
        seen = torch.from_numpy(masks)
        if isinstance(checkpoint, OfflineEvt):
            mean, _ = checkpoint.policy(seen[None])
            return answers | {"action": torch.tanh(mean[0]).numpy()}
        return answers | _adatracker(checkpoint, seen)


def _adatracker(checkpoint: AdaTracker, masks: Tensor) -> dict[str, Array]:
    """Return what there is besides the masks; pairs and actions from before the episode are zeros."""
    encoder, policy, meta = checkpoint.encoder, checkpoint.policy, checkpoint.meta
    config = policy.config
    past = Past(believes=config.belief, responds=config.response, period_s=1.0 / meta.rate_hz)
    past_masks = torch.cat((torch.zeros(config.history, *masks.shape[1:]), masks))
    past_actions = torch.zeros(config.history + len(masks), config.actions)
    contexts = torch.zeros(len(masks), config.told_context)
    beliefs = []
    last_action = torch.zeros(1, 1, config.actions)
    state: LstmState | None = None
    for tick, mask in enumerate(masks):
        window, z = slice(tick, tick + config.history), None
        target = belief.target_pixels(mask.numpy(), meta.mask)
        told = past.see(target, last_action[0, 0].numpy(), meta.action)
        beliefs.append(told.belief)
        if encoder is not None:
            z = encoder(past_masks[None, window], past_actions[None, window])[None]
            z = torch.cat((z, torch.from_numpy(told.response[None, None])), dim=-1)
            contexts[tick] = z[0, 0]
        believed = torch.from_numpy(told.belief[None, None]) if config.belief else None
        before = last_action if config.last_action else None
        mean, _, state = policy(mask[None, None], z, state, before, believed)
        last_action = torch.tanh(mean)
        if meta.search:
            last_action = torch.from_numpy(with_search(last_action.numpy(), past.search_yaw(), meta.action))
        past_actions[tick + config.history] = last_action[0, 0]
    answers = {"action": past_actions[config.history :].numpy()}
    if config.belief:
        answers["belief"] = np.stack(beliefs)
    return answers if encoder is None else answers | {"z": contexts.numpy()}


def walking_masks(spec: MaskSpec, ticks: int, seed: int) -> NDArray[np.float32]:
    """Return network inputs (ticks, C, S, S) of a scene that uses everything a mask can show.

    A target walks across, another person passes before it, a box stands by; for a while nothing is in view.
    """
    rng = np.random.default_rng(seed)
    painter = MaskPainter(spec, seed)
    start, end = rng.uniform(0.15, 0.85, 2)
    height = rng.uniform(0.35, 0.7, ticks + 1).cumsum() / np.arange(1, ticks + 2)
    box = rng.uniform(0.0, 0.7)
    side, pictures = spec.draw_size, []
    for tick in range(ticks):
        along = tick / max(ticks - 1, 1)
        scene = np.full((side, side), MaskClass.BACKGROUND, np.uint8)
        if not 0.6 < along < 0.75:
            near, far = (int(box * side), int(0.45 * side)), (int((box + 0.2) * side), int(0.75 * side))
            cv2.rectangle(scene, near, far, int(MaskClass.OBSTACLE), cv2.FILLED)
            _draw_person(scene, MaskClass.TARGET, start + (end - start) * along, height[tick], tick)
            _draw_person(scene, MaskClass.PERSON, end + (start - end) * along, 0.8 * height[tick], tick + 2)
        pictures.append(painter.paint(scene).copy())
    return np.stack(pictures)


def _draw_person(scene: ClassMask, kind: MaskClass, x: float, height: float, stride: int) -> None:
    """Draw a head, a trunk and two legs that swing; `x` and `height` are fractions of the picture."""
    side = len(scene)
    tall, centre, waist = height * side, x * side, 0.55 * side
    swing = 0.12 * tall * np.sin(0.8 * stride)
    thick = max(int(0.1 * tall), 1)
    cv2.circle(
        scene, (int(centre), int(waist - 0.42 * tall)), max(int(0.08 * tall), 1), int(kind), cv2.FILLED
    )
    trunk = (int(0.11 * tall), int(0.2 * tall))
    cv2.ellipse(scene, (int(centre), int(waist - 0.16 * tall)), trunk, 0, 0, 360, int(kind), cv2.FILLED)
    for sign in (-1, 1):
        foot = (int(centre + sign * swing), int(waist + 0.45 * tall))
        cv2.line(scene, (int(centre), int(waist)), foot, int(kind), thick)
