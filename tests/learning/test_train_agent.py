"""Training sees what deployment sees: one arithmetic over sequences, in visits and in an exported policy."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch

from adatracker_deploy.learning.checkpoint import ADATRACKER_MASK, AdaTracker
from adatracker_deploy.learning.data.dataset import Batch, Dataset
from adatracker_deploy.learning.data.recipe import load_recipe
from adatracker_deploy.learning.data.shard import distinct_patches, pack_masks, read_shard
from adatracker_deploy.learning.data.state import COLUMNS
from adatracker_deploy.learning.data.told import told_at_steps
from adatracker_deploy.learning.rollout import rollout
from adatracker_deploy.learning.tracking import ACTION
from adatracker_deploy.learning.train.agent import Agent, Sequences, drawn, statistics_of
from adatracker_deploy.learning.train.visitor import Visitor, visit_round
from adatracker_deploy.policy.drawing import MaskPainter
from tests.learning import fresh
from tests.tiers import EXHAUSTIVE

STEPS = 20
CONFIGS = {"whole": replace(fresh.CONFIG, size=64, last_action=True)} | {
    name: replace(config, size=64) for name, config in fresh.VARIANTS.items()
}


def an_agent(config):
    torch.manual_seed(5)
    agent = Agent(config).eval()
    with torch.no_grad():
        for weight in agent.parameters():
            weight.mul_(2.0)
    return agent


def classes(*shape, seed=0):
    coarse = np.random.default_rng(seed).integers(0, 4, (*shape, 8, 8), dtype=np.uint8)
    return coarse.repeat(8, axis=-1).repeat(8, axis=-2)


def batch_of(masks, actions, past, *, pooled=False):
    """Return whole episodes from their start, (B, L, ...), as a data set would."""
    count, length = masks.shape[:2]
    before = ((0, 0), (past, 0))
    blank = np.zeros((count, length), np.float32)
    body = np.zeros(count, np.float32)
    first, steps = np.arange(count) * length, masks.reshape(-1, 64, 64)
    told = told_at_steps(
        pack_masks(steps),
        actions.reshape(-1, 2),
        first,
        np.full(count, length),
        believes=True,
        responds=True,
    )
    beliefs, responses = (values.reshape(count, length, -1) for values in told)
    packed = pack_masks(np.pad(masks, (*before, (0, 0), (0, 0))))
    statistics = statistics_of(packed.reshape(-1, packed.shape[-1])).reshape(*packed.shape[:2], -1)
    return Batch(
        packed=packed,
        statistics=statistics.astype(np.float32) if pooled else np.zeros((*packed.shape[:2], 0), np.float32),
        actions=np.pad(actions, (*before, (0, 0))),
        experts=np.zeros_like(actions),
        rewards=blank,
        visible=blank > 0,
        done=blank > 0,
        valid=blank == 0,
        start=body == 0,
        height_m=body,
        log_limits=np.zeros((count, length, 3), np.float32),
        lag_s=blank,
        delay_s=blank,
        states=np.zeros((count, length, len(COLUMNS)), np.float32),
        beliefs=beliefs,
        responses=responses,
        inputs=np.zeros((count, length, 0), np.float32),
    )


def test_classes_are_drawn_as_at_deployment():
    masks = classes(3)
    painter = MaskPainter(ADATRACKER_MASK)
    np.testing.assert_array_equal(drawn(masks).numpy(), [painter.paint(mask).copy() for mask in masks])
    assert set(np.unique(drawn(masks))) == {0.0, 1.0}


@pytest.mark.parametrize("name", CONFIGS)
def test_a_visit_answers_as_the_exported_policy_and_as_training_sees_the_sequence(name):
    config = CONFIGS[name]
    agent = an_agent(config)
    masks = classes(STEPS)
    meta = replace(fresh.META, action=ACTION, mask=ADATRACKER_MASK)
    wanted = rollout(AdaTracker(agent.encoder, agent.policy, meta), drawn(masks).numpy())["action"]
    visitor, last = Visitor(agent), np.zeros((1, 2), np.float32)
    for tick, mask in enumerate(masks):
        last = visitor(mask[None], last, np.array([tick == 0]))
        np.testing.assert_allclose(last[0], wanted[tick], atol=1e-4)
    past, pooled = max(config.history, 1), config.front == "pooled"
    sequences = Sequences.of(batch_of(masks[None], wanted[None], past, pooled=pooled))
    with torch.no_grad():
        mean, _ = agent.policy.actor(agent.recall(sequences, context_every=1).x)
    np.testing.assert_allclose(torch.tanh(mean[0]), wanted, atol=1e-4)


def test_training_keeps_a_context_for_some_steps():
    agent = an_agent(CONFIGS["whole"])
    actions = np.random.default_rng(3).uniform(-1, 1, (1, STEPS, 2)).astype(np.float32)
    sequences = Sequences.of(batch_of(classes(1, STEPS), actions, agent.config.history))
    with torch.no_grad():
        every, kept = agent.recall(sequences, context_every=1).z, agent.recall(sequences, context_every=3).z
    assert kept.shape == every.shape
    for step in range(STEPS):
        np.testing.assert_allclose(kept[:, step], every[:, step - step % 3], atol=1e-6)


def test_a_new_episode_begins_as_the_first_did_and_leaves_the_others_alone():
    visitor = Visitor(an_agent(CONFIGS["whole"]))
    masks, none = classes(STEPS, 2), np.zeros((2, 2), np.float32)
    first = [visitor(pair, none, np.full(2, tick == 0)) for tick, pair in enumerate(masks)]
    again = [
        visitor(pair[::-1].copy(), none, np.array([tick == 0, False])) for tick, pair in enumerate(masks)
    ]
    np.testing.assert_allclose([a[0] for a in again], [a[1] for a in first], atol=1e-5)
    assert not np.allclose([a[1] for a in again], [a[0] for a in first], atol=1e-3)


def test_both_networks_of_an_agent_look_through_one_backbone():
    agent = Agent(CONFIGS["whole"])
    assert agent.encoder.backbone is agent.policy.backbone


@EXHAUSTIVE
def test_any_number_of_workers_visits_the_same_and_what_is_there_is_kept(tmp_path):
    recipe, agent = replace(load_recipe("paper"), episode_steps=8), an_agent(CONFIGS["whole"])
    told = {"steps": 300, "seed": [1, 2]}
    alone = visit_round(agent, recipe, folder=tmp_path / "alone", workers=1, **told)
    pair = visit_round(agent, recipe, folder=tmp_path / "pair", workers=2, **told)
    assert [len(Dataset.open([part])) for part in alone] == [128, 128, 44]
    for one, other in zip(alone, pair, strict=True):
        ours, theirs = (read_shard(part / "shard-00000.npz") for part in (one, other))
        assert ours.episodes == theirs.episodes
        np.testing.assert_array_equal(ours.steps.actions, theirs.steps.actions)
    before = {part: part.stat().st_mtime_ns for part in alone}
    shutil.rmtree(alone[1])
    assert visit_round(agent, recipe, folder=tmp_path / "alone", workers=1, **told) == alone
    changed = [part for part in alone if part.stat().st_mtime_ns != before[part]]
    assert changed == [alone[1]]


def test_the_backbone_sees_the_same_in_patches_as_in_drawn_masks_and_learns_the_same():
    backbone, masks = an_agent(CONFIGS["whole"]).policy.backbone, classes(2, 3)
    kinds, place = distinct_patches(pack_masks(masks))
    gradients, features = [], []
    for seen in (
        lambda: backbone.sequences(drawn(masks)),
        lambda: backbone.of_patches(drawn(kinds), torch.from_numpy(place)),
    ):
        backbone.zero_grad()
        features.append(seen())
        (features[-1] ** 2).sum().backward()
        gradients.append([weight.grad.clone() for weight in backbone.parameters()])
    torch.testing.assert_close(features[1], features[0], rtol=1e-4, atol=1e-4)
    for patched, whole in zip(*gradients[::-1], strict=True):
        torch.testing.assert_close(patched, whole, rtol=1e-3, atol=1e-2)
