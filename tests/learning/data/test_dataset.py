"""Sequences carry their own past, starts are as at deployment, and bad shards are refused."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.learning.change import Change
from adatracker_deploy.learning.data import shard as module
from adatracker_deploy.learning.data.dataset import Dataset
from adatracker_deploy.learning.data.shard import (
    EpisodeHeader,
    Shard,
    Steps,
    distinct_patches,
    pack_masks,
    read_shard,
    unpack_masks,
    write_shard,
)
from adatracker_deploy.learning.data.state import COLUMNS
from adatracker_deploy.learning.embodiment import Embodiment
from adatracker_deploy.learning.episode_spec import EpisodeSpec
from adatracker_deploy.policy import belief
from adatracker_deploy.policy.past import over_time


def episode(seed: int, length: int):
    """An episode whose every number tells where it is from: actions hold (seed, step) in thousandths."""
    t = np.arange(length)
    mark = np.stack([np.full(length, seed), t], axis=1).astype(np.float32) / 1000
    masks = np.zeros((length, 64, 64), np.uint8)
    masks[:, 0, 0] = 1 + t % 3
    body = Embodiment(height_m=1.0 + seed, forward_m_s=2.0, lag_s=0.1, delay_s=0.2)
    steps = Steps(
        masks=pack_masks(masks),
        actions=mark,
        experts=-mark,
        rewards=t.astype(np.float32) + 1,
        visible=np.ones(length, bool),
        dropped=np.zeros(length, bool),
        done=t == length - 1,
        states=np.full((length, len(COLUMNS)), seed, np.float32) + t[:, None].astype(np.float32) / 1000,
        finals=np.full((1, len(COLUMNS)), seed + length / 1000, np.float32),
    )
    return EpisodeHeader(spec=EpisodeSpec(seed=seed, embodiment=body), steps=length), steps


LENGTHS = (30, 7, 12)
RECORDS = [episode(seed, length) for seed, length in enumerate(LENGTHS)]


@pytest.fixture
def dataset():
    return Dataset([header for header, _ in RECORDS], Steps.joined([steps for _, steps in RECORDS]))


def shard_of(records) -> Shard:
    return module.joined_shard("test", records)


@settings(max_examples=50)
@given(seed=st.integers(0, 1 << 32), count=st.integers(0, 4))
def test_packed_masks_come_back_as_they_were(seed, count):
    masks = np.random.default_rng(seed).integers(0, 4, (count, 64, 64), np.uint8)
    assert pack_masks(masks).shape == (count, 1024)
    assert np.array_equal(unpack_masks(pack_masks(masks)), masks)


@settings(max_examples=30)
@given(seed=st.integers(0, 1 << 32), flat=st.booleans())
def test_masks_are_made_of_their_different_patches(seed, flat):
    masks = np.random.default_rng(seed).integers(0, 4, (2, 3, 64, 64), np.uint8)
    masks[:, :, 8:] *= not flat
    kinds, place = distinct_patches(pack_masks(masks))
    assert len(np.unique(kinds, axis=0)) == len(kinds)
    patches = kinds[place].reshape(2, 3, 16, 16, 4, 4)
    assert np.array_equal(patches.swapaxes(3, 4).reshape(masks.shape), masks)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 1 << 32), length=st.integers(1, 20), history=st.integers(0, 9))
def test_every_place_of_a_batch_is_the_right_step_or_nothing(seed, length, history):
    data = Dataset([header for header, _ in RECORDS], Steps.joined([steps for _, steps in RECORDS]))
    batch = data.sample(np.random.default_rng(seed), 8, length, history)
    for row in range(8):
        episode_index = round(float(batch.height_m[row])) - 1
        now = batch.valid[row]
        assert now[0]
        first = round(float(batch.rewards[row, 0])) - 1
        assert batch.start[row] == (first == 0)
        for place in range(history + length):
            t = first + place - history
            exists = 0 <= t < LENGTHS[episode_index]
            wanted = np.array([episode_index, t], np.float32) / 1000 if exists else np.zeros(2)
            assert np.allclose(batch.actions[row, place], wanted)
            mask = unpack_masks(batch.packed[row, place])
            assert mask[0, 0] == mask.sum() == (1 + t % 3 if exists else 0)
            if place >= history:
                assert batch.valid[row, place - history] == exists
                assert np.allclose(batch.experts[row, place - history], -wanted)
                assert batch.done[row, place - history] == (t == LENGTHS[episode_index] - 1)


def test_a_quarter_of_the_sequences_and_a_little_more_start_at_an_episodes_start(dataset):
    batch = dataset.sample(np.random.default_rng(0), 20_000, 6, 2)
    assert 0.25 < batch.start.mean() < 0.4
    assert not batch.packed[batch.start][:, :2].any()
    assert not batch.actions[batch.start][:, :2].any()


def test_the_bodys_numbers_stand_beside_each_sequence(dataset):
    batch = dataset.sample(np.random.default_rng(0), 4, 6, 2)
    assert np.allclose(batch.log_limits[..., 0], math.log(2.0))
    assert np.allclose(batch.log_limits[..., 1], math.log(1.3))
    assert np.allclose(batch.log_limits[..., 2], math.log(math.radians(120)))
    assert np.allclose(batch.lag_s, 0.1)
    assert np.allclose(batch.delay_s, 0.2)


def test_a_body_that_changes_is_another_from_that_step_on():
    header, steps = RECORDS[0]
    spec = dataclasses.replace(header.spec, change=Change(at_step=10, yaw=0.5, more_lag_s=0.3))
    data = Dataset([dataclasses.replace(header, spec=spec)], steps)
    batch = data.take(np.array([0, 0]), np.array([0, 7]), 6, 4)
    assert np.allclose(batch.lag_s, [[0.1] * 6, [0.1] * 3 + [0.4] * 3])
    yaw = np.exp(batch.log_limits[1, :, 2]) / math.radians(120)
    assert np.allclose(yaw, [1, 1, 1, 0.5, 0.5, 0.5])


def test_equal_generators_draw_equal_batches(dataset):
    a, b = (dataset.sample(np.random.default_rng(7), 5, 6, 3) for _ in range(2))
    for name in (field.name for field in dataclasses.fields(a)):
        assert np.array_equal(getattr(a, name), getattr(b, name))


def test_a_belief_begins_with_its_episode_and_knows_more_than_its_sequence():
    """In every sequence the belief is that of the whole episode, computed alone from its start."""
    masks = np.zeros((30, 64, 64), np.uint8)
    masks[:5, 20:40, 10:20] = MaskClass.TARGET  # seen in the first steps and never again
    (_, steps), records = RECORDS[0], list(RECORDS)
    records[0] = (RECORDS[0][0], dataclasses.replace(steps, masks=pack_masks(masks)))
    joined = Steps.joined([steps for _, steps in records])
    data = Dataset([header for header, _ in records], joined).told(believes=True, responds=False)
    sights = belief.sight_of(masks == MaskClass.TARGET)
    whole = over_time(sights, records[0][1].actions, believes=True, responds=False, period_s=0.1).belief
    late = data.take(np.array([0]), np.array([12]), 6, 2)
    assert np.allclose(late.beliefs[0], whole[12:18])
    assert np.allclose(late.beliefs[0, :, belief.COLUMNS.index("left")], 1 - 30 / 64, atol=1e-6)
    short = data.take(np.array([1]), np.array([0]), 10, 2).beliefs[0]
    assert short[:7].any(axis=1).all()
    assert not short[7:].any()
    assert data.take(np.array([2]), np.array([3]), 2, 2).beliefs.shape == (1, 2, belief.SIZE)


def test_shards_of_several_folders_are_one_data_set(tmp_path):
    for index, record in enumerate(RECORDS):
        (tmp_path / str(index)).mkdir()
        write_shard(tmp_path / str(index) / "shard-00000.npz", shard_of([record]))
    data = Dataset.open([tmp_path / "0", tmp_path / "2"])
    assert [header.spec.seed for header in Dataset.open([tmp_path]).headers] == [0, 1, 2]
    assert len(data) == 42
    assert [header.spec.seed for header in data.headers] == [0, 2]


def test_a_shard_comes_back_as_it_was(tmp_path):
    path = tmp_path / "shard-00000.npz"
    write_shard(path, shard_of(RECORDS))
    read = read_shard(path)
    assert read.episodes == tuple(header for header, _ in RECORDS)
    assert np.array_equal(read.steps.masks, Steps.joined([steps for _, steps in RECORDS]).masks)
    assert list(tmp_path.iterdir()) == [path]


def test_no_shards_at_all_are_refused(tmp_path):
    with pytest.raises(UsageError, match=r"no shards and no trials in .*: collect some first"):
        Dataset.open([tmp_path])


@settings(max_examples=40, deadline=None)
@given(share=st.floats(0, 0.999))
def test_a_shard_cut_anywhere_is_refused_in_one_line(tmp_path_factory, share):
    folder = tmp_path_factory.mktemp("cut")
    path = folder / "shard-00000.npz"
    write_shard(path, shard_of(RECORDS))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(UsageError, match="damaged or cut short"):
        Dataset.open([folder])


def test_a_flipped_byte_in_the_masks_is_noticed(tmp_path):
    path = tmp_path / "shard-00000.npz"
    write_shard(path, shard_of(RECORDS))
    damaged = bytearray(path.read_bytes())
    damaged[damaged.index(b"masks.npy") + 60] ^= 0xFF
    path.write_bytes(bytes(damaged))
    with pytest.raises(UsageError, match="damaged or cut short"):
        read_shard(path)


def test_a_shard_of_another_schema_is_refused_by_name(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "SCHEMA", "adatracker-shard-0")
    write_shard(tmp_path / "shard-00000.npz", shard_of(RECORDS))
    monkeypatch.undo()
    with pytest.raises(UsageError, match="schema 'adatracker-shard-0' is not 'adatracker-shard-2'"):
        Dataset.open([tmp_path])


def test_arrays_that_do_not_fit_the_header_are_refused(tmp_path):
    header, steps = RECORDS[0]
    longer = dataclasses.replace(header, steps=header.steps + 1)
    write_shard(tmp_path / "shard-00000.npz", shard_of([(longer, steps)]))
    with pytest.raises(UsageError, match="masks: expected uint8 of shape"):
        Dataset.open([tmp_path])


def test_a_single_step_leads_to_the_state_after_it_and_the_last_one_to_where_its_episode_ended(dataset):
    moves = dataset.moves(np.random.default_rng(0), 2000)
    np.testing.assert_allclose(moves.nexts - moves.states, 0.001, atol=2e-6)
    seed, t = np.rint(moves.actions * 1000).T
    np.testing.assert_allclose(moves.states[:, 0], seed + t / 1000, atol=1e-6)
    np.testing.assert_array_equal(moves.done, t + 1 == np.take(LENGTHS, seed.astype(int)))
    np.testing.assert_array_equal(moves.rewards, t + 1)
    assert set(seed) == {0, 1, 2}


def test_data_that_follow_others_are_as_if_all_had_been_opened_at_once():
    def part(records):
        data = Dataset([header for header, _ in records], Steps.joined([steps for _, steps in records]))
        statistics = np.arange(len(data), dtype=np.float16)[:, None] % 64
        return data.told(believes=True, responds=True).with_statistics(statistics)

    both = part(RECORDS[:1]).followed_by(part(RECORDS[1:]))
    whole, episodes = part(RECORDS), np.arange(len(RECORDS))
    assert both.headers == whole.headers
    one, other = (data.take(episodes, np.zeros_like(episodes), 8, 4) for data in (both, whole))
    for name in (field.name for field in dataclasses.fields(one) if field.name != "statistics"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    alone = part(RECORDS[1:]).take(episodes[:1], np.zeros(1, np.int64), 8, 4)
    np.testing.assert_array_equal(one.statistics[1], alone.statistics[0])
