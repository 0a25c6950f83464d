"""A thing is followed by its mask through four graphs, by any names, and is lost when it is gone."""

from __future__ import annotations

import numpy as np
import pytest

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.models.catalogue import open_model
from adatracker_deploy.perception.models.memory_bank import MemoryBank, Remembered
from adatracker_deploy.perception.models.sam2 import Sight
from tests.perception.models import sam2_graphs
from tests.perception.models.sam2_graphs import PLAIN, PREFIXED

RED, BLUE = (255, 0, 0), (0, 0, 255)
OWN = PLAIN | {"image": "x", "mask": "m", "a_memory": "bank"}
OWN_MAP = {
    "image_encoder.picture": "x",
    "image_decoder.mask": "m",
    "memory_attention.memory": "bank",
}


def scene(red=None, blue=None):
    """A 128 x 128 picture with blocks of 32 px at these (left, top)."""
    made = np.zeros((128, 128, 3), np.uint8)
    for at, colour in ((red, RED), (blue, BLUE)):
        if at is not None:
            made[at[1] : at[1] + 32, at[0] : at[0] + 32] = colour
    return made


def mask_at(left, top, cells=128):
    side = cells // 4
    left, top = left * cells // 128, top * cells // 128
    mask = np.zeros((cells, cells), bool)
    mask[top : top + side, left : left + side] = True
    return mask


@pytest.fixture(params=[(PLAIN, {}), (PREFIXED, {}), (OWN, OWN_MAP)], ids=["plain", "prefixed", "mapped"])
def dialect(request):
    return request.param


@pytest.fixture
def follow(tmp_path, sidecar):
    def open_it(names=PLAIN, tensors=None, **options):
        path = sidecar(**sam2_graphs.write(tmp_path, names, **options), tensors=tensors or {})
        return open_model(path)

    return open_it


@pytest.mark.parametrize("scored", [True, False])
def test_a_thing_is_followed_past_another(follow, dialect, scored):
    model = follow(*dialect, scored=scored)
    model.start(scene((32, 32), (80, 80)), mask_at(32, 32, 64))
    for left in (32, 48, 64, 80, 96, 80, 64, 48, 32, 16):
        mask, score = model.step(scene((left, 32), (48, 80)))
        np.testing.assert_array_equal(mask, mask_at(left, 32, 16))
        assert score > 0.9


@pytest.mark.parametrize("scored", [True, False])
def test_a_thing_that_is_gone_has_no_mask_and_is_found_again_at_once(follow, scored):
    model = follow(scored=scored)
    model.start(scene((32, 32), (80, 80)), mask_at(32, 32))
    for _ in range(3):
        mask, score = model.step(scene(None, (80, 80)))
        assert not mask.any()
        assert score <= 0.5
    mask, _ = model.step(scene((48, 32), (80, 80)))
    np.testing.assert_array_equal(mask, mask_at(48, 32, 16))


def test_what_a_thing_turns_into_is_remembered(follow):
    """Red, then yellow for a while, then green: without the memory of yellow, green is nothing."""
    model = follow()
    model.start(scene((32, 32)), mask_at(32, 32))
    for colour in (*[(255, 255, 0)] * 3, (0, 255, 0)):
        now = np.zeros((128, 128, 3), np.uint8)
        now[32:64, 32:64] = colour
        np.testing.assert_array_equal(model.step(now).mask, mask_at(32, 32, 16))


def test_a_mask_of_everything_is_a_lost_thing(follow):
    model = follow(scored=False)
    model.start(scene((32, 32)), mask_at(32, 32))
    mask, score = model.step(np.full((128, 128, 3), RED, np.uint8))
    assert not mask.any()
    assert score == 0


def test_a_decoder_that_takes_one_point_gets_one_inside(follow):
    model = follow(points=1)
    model.start(scene((32, 32)), mask_at(32, 32))
    np.testing.assert_array_equal(model.step(scene((48, 32))).mask, mask_at(48, 32, 16))


def test_starting_again_forgets_the_first_thing(follow):
    model = follow()
    both = scene((32, 32), (80, 80))
    model.start(both, mask_at(32, 32))
    model.start(both, mask_at(80, 80))
    np.testing.assert_array_equal(model.step(both).mask, mask_at(80, 80, 16))


def test_an_empty_mask_and_a_step_before_the_start_are_refused(follow):
    model = follow()
    with pytest.raises(UsageError, match="the mask is empty"):
        model.start(scene((32, 32)), np.zeros((8, 8), bool))
    with pytest.raises(RuntimeError):
        model.step(scene((32, 32)))


def test_names_that_no_graph_has_are_told_with_those_that_it_has(tmp_path, sidecar, refusal):
    keys = sam2_graphs.write(tmp_path, OWN)
    assert "image_encoder.onnx: has no input 'image' or" in refusal(sidecar(**keys))
    assert "x [1, 3, 64, 64] float32" in refusal(sidecar(**keys))
    assert "expected GRAPH.NAME" in refusal(sidecar(**keys, tensors={"picture": "x"}))
    assert "expected image_encoder, memory_attention" in refusal(sidecar(kind="sam2"))


def remembered(value):
    positions = np.zeros((2, 1, 3), np.float32)
    return Remembered(np.full((1, 1), value), positions, np.full((1, 6), value))


def test_the_bank_holds_the_prompted_frame_and_the_last_six_each_with_its_age():
    codes = np.arange(7, dtype=np.float32).reshape(7, 1, 1, 1) * np.ones(3, np.float32)
    bank = MemoryBank(remembered(0), codes)
    for number in range(1, 21):
        bank.add(remembered(number))
    features, pointers, positions = bank.recall()
    assert features[:, 0].tolist() == [0, 20, 19, 18, 17, 16, 15]
    assert pointers[:, 0].tolist() == [0, *range(20, 5, -1)]
    assert positions.shape == (7 * 2 + 16 * 2, 1, 3)
    assert positions[:14:2, 0, 0].tolist() == [6, 0, 1, 2, 3, 4, 5]
    assert not positions[14:].any()


def test_sight_is_lost_by_jumps_and_growth_and_more_patient_the_longer_it_is_lost():
    sight = Sight(mask_at(0, 0))
    assert not sight.sees(mask_at(96, 96))  # three diagonals away
    assert sight.sees(mask_at(96, 96))  # allowed after one miss: 1.5 diagonals twice
    assert sight.sees(mask_at(96, 64))
    large = np.zeros((128, 128), bool)
    large[10:120, 40:128] = True
    assert not sight.sees(large)
    assert not sight.sees(np.zeros((128, 128), bool))
