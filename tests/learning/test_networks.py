"""The networks have the paper's inputs and outputs, and the streaming encoder is the window encoder."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.learning.graphs import StreamingEncoder
from adatracker_deploy.learning.networks import (
    AdaTrackerConfig,
    Backbone,
    ContextEncoder,
    ContextHeads,
    ContextPolicy,
    OfflineEvtPolicy,
)
from tests.learning import fresh

K = fresh.CONFIG.history
PICTURE = (fresh.CONFIG.channels, fresh.CONFIG.size, fresh.CONFIG.size)


def test_the_default_networks_take_batches_of_histories_and_sequences():
    config = AdaTrackerConfig()
    z = ContextEncoder(config)(torch.rand(2, 16, 3, 64, 64), torch.rand(2, 16, 2))
    mean, log_std, (h, c) = ContextPolicy(config)(torch.rand(2, 7, 3, 64, 64), z[:, None].expand(-1, 7, -1))
    reward, height = ContextHeads(config)(z)
    shapes = [tuple(t.shape) for t in (z, mean, log_std, h, c, reward, height)]
    assert shapes == [(2, 16), (2, 7, 2), (2, 7, 2), (1, 2, 128), (1, 2, 128), (2,), (2,)]


def test_offline_evt_takes_sequences_of_colour_masks():
    mean, (h, c) = OfflineEvtPolicy()(255 * torch.rand(1, 3, 3, 64, 64))
    assert [tuple(t.shape) for t in (mean, h, c)] == [(1, 3, 2), (1, 1, 64), (1, 1, 64)]


def test_a_sequence_is_the_same_as_its_steps_one_by_one():
    policy = fresh.adatracker().policy
    masks, z = torch.rand(1, 6, *PICTURE), torch.rand(1, 6, fresh.CONFIG.context)
    whole, _, _ = policy(masks, z)
    state, steps = None, []
    for tick in range(6):
        mean, _, state = policy(masks[:, tick : tick + 1], z[:, tick : tick + 1], state)
        steps.append(mean)
    torch.testing.assert_close(torch.cat(steps, dim=1), whole, atol=1e-5, rtol=0)


@settings(deadline=None, max_examples=40)
@given(ticks=st.integers(1, 3 * K), seed=st.integers(0, 999))
def test_streaming_equals_the_window_from_the_first_tick_on(ticks, seed):
    checkpoint = fresh.adatracker(seed)
    streaming = StreamingEncoder(checkpoint.encoder)
    masks, actions = torch.rand(ticks, *PICTURE), 2 * torch.rand(ticks, fresh.CONFIG.actions) - 1
    blank_masks, blank_actions = torch.zeros(K, *PICTURE), torch.zeros(K, fresh.CONFIG.actions)
    all_masks, all_actions = torch.cat((blank_masks, masks)), torch.cat((blank_actions, actions))
    history = torch.zeros(1, K, fresh.CONFIG.features + fresh.CONFIG.actions)
    with torch.no_grad():
        for newest in range(K - 1, K + ticks):
            z, history = streaming(all_masks[newest, None], all_actions[newest, None], history)
            window = slice(newest + 1 - K, newest + 1)
            wanted = checkpoint.encoder(all_masks[None, window], all_actions[None, window])
            torch.testing.assert_close(z, wanted, atol=1e-5, rtol=0)


@pytest.mark.parametrize("place", range(K))
def test_the_context_depends_on_every_pair_of_the_window_and_on_its_order(place):
    encoder = fresh.adatracker().encoder
    masks, actions = torch.rand(1, K, *PICTURE), torch.rand(1, K, fresh.CONFIG.actions)
    other_masks, other_actions = masks.clone(), actions.clone()
    other_masks[0, place] = 0
    other_actions[0, place] *= -1
    with torch.no_grad():
        z = encoder(masks, actions)
        assert not torch.allclose(z, encoder(other_masks, actions), atol=1e-5)
        assert not torch.allclose(z, encoder(masks, other_actions), atol=1e-5)
        assert not torch.allclose(z, encoder(masks.flip(1), actions.flip(1)), atol=1e-3)


@settings(deadline=None, max_examples=30)
@given(size=st.integers(16, 100))
def test_masks_of_any_size_are_taken(size):
    features = Backbone(AdaTrackerConfig(size=size))(torch.rand(2, 3, size, size))
    assert features.shape == (2, 96)
