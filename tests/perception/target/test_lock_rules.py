"""The lock keeps its rules whatever people do and whatever a detector finds."""

from __future__ import annotations

import itertools
import math
import random

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from adatracker_deploy.core.messages import TargetState
from adatracker_deploy.perception.target.lock import TargetLock
from tests.perception.target.walkers import CLOTHES, WIDE, Walker, along, follow, followed, looking, states
from tests.tiers import examples

AFTER = {
    TargetState.TRACKED: {TargetState.TRACKED, TargetState.COASTING, TargetState.LOST},
    TargetState.COASTING: {TargetState.TRACKED, TargetState.COASTING, TargetState.LOST},
    TargetState.LOST: {TargetState.LOST, TargetState.REACQUIRED},
    TargetState.REACQUIRED: {TargetState.TRACKED, TargetState.COASTING, TargetState.LOST},
}
"""The allowed changes of state; lost at once where a second passes between two pictures."""


def lawful(said):
    for before, after in itertools.pairwise(states(said)):
        assert after in AFTER[before]
    for sight, answer in said:
        assert (answer.place is None) == (answer.state in (TargetState.COASTING, TargetState.LOST))
        assert answer.place is None or 0 <= answer.place < len(sight.boxes)
        assert 0 <= answer.likeness <= 1
        assert answer.place is not None or answer.likeness == 0


RUNNING_PX_S = 240
"""2.4 body heights a second: a person 1.7 m tall runs at 4 m/s."""


@st.composite
def crowds(draw, clothes=None, fastest_px_s=math.inf):
    """Draw two to four people who wander, cross, leave and return; the last is nearest: in sight at first."""
    names = draw(
        st.permutations(list(CLOTHES)) if clothes is None else st.lists(clothes, min_size=4, max_size=4)
    )
    walkers = []
    for name in names[: draw(st.integers(2, 4))]:
        times = [0.0, *sorted(draw(st.lists(st.floats(0.1, 6), min_size=1, max_size=4, unique=True)))]
        places = [draw(st.integers(30, 450))]
        for before_s, then_s in itertools.pairwise(times):
            reach = fastest_px_s * (then_s - before_s)
            wanted = draw(st.integers(-40, 520))
            places.append(min(max(wanted, places[-1] - reach), places[-1] + reach))
        gone_s = draw(st.floats(0.2, 6))
        back_s = gone_s + draw(st.floats(0, 5))
        walkers.append(
            Walker(
                name,
                along(times, places),
                here=lambda t_s, gone=gone_s, back=back_s: not gone <= t_s < back,
                tall=draw(st.integers(80, 120)),
            )
        )
    return walkers


def true_middle(walker, sight, said):
    return walker.x((sight.t_ns - said[0][0].t_ns) / 1e9)


@settings(max_examples=examples(15, of=60))
@given(crowds(fastest_px_s=RUNNING_PX_S), st.randoms(use_true_random=False))
def test_whoever_is_named_always_wears_the_targets_clothes(walkers, chance):
    said = follow(walkers, 6, target=len(walkers) - 1, order=chance.shuffle)
    assert {walkers[who].clothes for who in followed(said) if who is not None} <= {walkers[-1].clothes}
    lawful(said)


@settings(max_examples=examples(15, of=60))
@given(crowds(), st.randoms(use_true_random=False))
def test_where_people_jump_only_who_was_right_behind_the_target_is_named_and_only_while_it_is_not_seen(
    walkers, chance
):
    """A person uncovered by a target that jumps out of the picture looks half like it in that picture."""
    said = follow(walkers, 6, target=len(walkers) - 1, order=chance.shuffle)
    for (sight, answer), who in zip(said, followed(said), strict=True):
        if who is not None and walkers[who].clothes != walkers[-1].clothes:
            assert len(walkers) - 1 not in sight.who
            left, _, right, _ = sight.boxes[answer.place]
            assert abs((left + right) / 2 - true_middle(walkers[-1], sight, said)) <= WIDE
    lawful(said)


@settings(max_examples=25)
@given(crowds(), st.integers(0, 999))
def test_while_a_fifth_of_people_are_missed_the_place_is_still_the_targets(walkers, seed):
    """Somebody wrongly named when the target was just missed stands right before or behind it."""
    chance = random.Random(seed)
    pictures = itertools.count()

    def missed(who):
        if next(pictures):
            who[:] = [each for each in who if chance.random() > 0.2]

    said = follow(walkers, 6, target=len(walkers) - 1, order=missed)
    for (sight, answer), who in zip(said, followed(said), strict=True):
        if who is not None:
            left, _, right, _ = sight.boxes[answer.place]
            apart = abs((left + right) / 2 - true_middle(walkers[-1], sight, said))
            assert who == len(walkers) - 1 or apart <= WIDE
    lawful(said)


@settings(max_examples=25)
@given(crowds(clothes=st.sampled_from(["red", "green"])))
def test_whatever_people_wear_the_states_are_in_lawful_order_and_the_same_again(walkers):
    said, again = (follow(walkers, 6, target=len(walkers) - 1) for _ in range(2))
    lawful(said)
    assert [answer for _, answer in said] == [answer for _, answer in again]


@st.composite
def any_pictures(draw):
    """Draw random boxes, sure and not, looks, motions and times, such as no camera ever gave."""
    pictures = []
    for _ in range(draw(st.integers(2, 12))):
        count = draw(st.integers(0 if pictures else 1, 5))
        corner = draw(arrays.arrays(np.float32, (count, 2), elements=st.floats(0, 600, width=32)))
        side = draw(arrays.arrays(np.float32, (count, 2), elements=st.floats(1, 400, width=32)))
        pictures.append(
            (
                np.hstack((corner, corner + side)),
                draw(arrays.arrays(np.float32, count, elements=st.floats(0, 1, width=32))),
                looking(draw(st.lists(st.integers(0, 3), min_size=count, max_size=count))),
                _motion(draw(st.floats(-0.5, 0.5)), draw(st.floats(0.8, 1.25)), draw(st.floats(-99, 99))),
                draw(st.sampled_from([0, 1, 50_000_000, 400_000_000, 5_000_000_000])),
                draw(st.none() | st.integers(0, count)),
            )
        )
    return pictures


def _motion(turn, zoom, shift):
    c, s = zoom * np.cos(turn), zoom * np.sin(turn)
    return np.array([[c, -s, shift], [s, c, -shift]])


@given(any_pictures())
def test_whatever_a_detector_finds_the_lock_answers_by_the_rules(pictures):
    class Sight:
        def __init__(self, boxes):
            self.boxes = boxes

    def run():
        lock = TargetLock()
        boxes, _, looks, _, t_ns, _ = pictures[0]
        said = [(Sight(boxes), lock.choose(len(boxes) - 1, boxes, looks, t_ns))]
        for boxes, scores, looks, motion, dt_ns, sure in pictures[1:]:
            t_ns += dt_ns
            said.append((Sight(boxes), lock.update(boxes, scores, looks, motion, t_ns, sure=sure)))
        return said

    said = run()
    lawful(said)
    assert [answer for _, answer in said] == [answer for _, answer in run()]
