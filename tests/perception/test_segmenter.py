"""Only a valid observation of the frame gets through from a segmenter; anything else stops the robot."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from streams import until

from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import Box, Frame, Observation
from adatracker_deploy.perception import pipeline
from adatracker_deploy.perception.pipeline import Perception, perceive, refuse_hung
from adatracker_deploy.perception.segmenter import TruthSegmenter, check_observation

FRAME = Frame(np.zeros((48, 64, 3), np.uint8), 7_000_000_000, 3)
MASK = np.zeros((160, 160), np.uint8)
GOOD = Observation(MASK, Box(0.5, 0.5, 0.2, 0.4), 0.9, FRAME.t_ns, FRAME.seq)
NAN = float("nan")


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"box": None},
        {"box": Box(0.5, 0.5, 1.0, 1.0)},
        {"box": Box(0.0, 1.0, 0.001, 0.001)},
        {"confidence": 0.0},
        {"confidence": 1.0},
        {"mask": np.full((1, 7), 3, np.uint8)},
    ],
)
def test_an_observation_of_the_frame_gets_through(change):
    check_observation(replace(GOOD, **change), FRAME)


NONSENSE = [
    ({"seq": 2}, "of another frame"),
    ({"t_ns": FRAME.t_ns - 1}, "of another frame"),
    ({"mask": np.zeros((160, 160, 1), np.uint8)}, "invalid class mask"),
    ({"mask": np.zeros(160, np.uint8)}, "invalid class mask"),
    ({"mask": np.zeros((160, 160))}, "invalid class mask"),
    ({"mask": np.zeros((160, 160), bool)}, "invalid class mask"),
    ({"mask": np.zeros((0, 160), np.uint8)}, "invalid class mask"),
    ({"mask": np.full((160, 160), 4, np.uint8)}, "invalid class mask"),
    ({"mask": np.full((160, 160), 255, np.uint8)}, "invalid class mask"),
    *(
        ({"box": Box(**({"cx": 0.5, "cy": 0.5, "w": 0.2, "h": 0.4} | {side: value}))}, "an invalid box")
        for side, values in {
            "cx": (-0.01, 1.01, NAN, np.inf),
            "cy": (-0.01, 1.01, NAN),
            "w": (0, -0.2, 1.01, NAN),
            "h": (0, -0.2, 1.01, NAN),
        }.items()
        for value in values
    ),
    ({"confidence": -0.01}, "a confidence of -0.01"),
    ({"confidence": 1.01}, "a confidence of 1.01"),
    ({"confidence": NAN}, "a confidence of nan"),
]


@pytest.mark.parametrize(("change", "reason"), NONSENSE)
def test_nonsense_is_refused_in_one_sentence(change, reason):
    with pytest.raises(PlatformError, match=f"^segmenter: returned .*{reason}") as refused:
        perceive(FRAME, lambda frame: replace(GOOD, **change))
    assert len(str(refused.value).splitlines()) == 1


class Still:
    """A camera that always shows the same thing, in a new frame each time."""

    def __init__(self):
        self.seq = 0

    def read(self, now_ns):
        self.seq += 1
        return Frame(FRAME.rgb, now_ns, self.seq)


def ended_by(segmenter):
    """Run perception until it has ended, and return the error that says why."""
    with Perception(Still(), segmenter, FakeClock(), 20.0) as perception:
        perception._thread.join(10)
        assert not perception._thread.is_alive()
        with pytest.raises(PlatformError) as ended:
            perception.newest()
        with pytest.raises(PlatformError):  # and so for whoever asks again
            perception.newest()
    return ended.value


def good(frame):
    return replace(GOOD, t_ns=frame.t_ns, seq=frame.seq)


@pytest.mark.parametrize(
    ("gives", "reason"),
    [
        (lambda frame: None, "perception: AttributeError"),
        (lambda frame: "person", "perception: AttributeError"),
        (lambda frame: replace(good(frame), mask=[[0]]), "perception: AttributeError"),
        (lambda frame: replace(good(frame), box=(0, 0, 1, 1)), "perception: AttributeError"),
        (lambda frame: replace(good(frame), confidence=None), "perception: TypeError"),
        (lambda frame: replace(good(frame), confidence=2.0), "segmenter: returned a confidence of 2.0"),
        (lambda frame: replace(good(frame), seq=0), "segmenter: returned an observation of another frame"),
        (TruthSegmenter(), "this frame carries no truth"),
    ],
)
def test_rubbish_ends_perception_with_a_sentence(gives, reason):
    assert str(ended_by(gives)).startswith(reason)


@pytest.mark.parametrize(
    "error",
    [
        ValueError("odd"),
        MemoryError(),
        RecursionError(),
        AssertionError(),
        SystemExit(3),
        KeyboardInterrupt(),
    ],
)
def test_whatever_a_segmenter_raises_is_told(error):
    def fails(frame):
        raise error

    ended = ended_by(fails)
    assert type(error).__name__ in str(ended)
    assert ended.__cause__ is error


def test_a_good_beginning_does_not_hide_a_bad_end():
    def twice(frame):
        if frame.seq > 2:
            raise ValueError("tired")
        return good(frame)

    assert "tired" in str(ended_by(twice))


def test_the_loop_never_waits_for_a_segmenter_that_stalls(monkeypatch):
    monkeypatch.setattr(pipeline, "CLOSE_TIMEOUT_S", 0.05)
    stalled, mended = threading.Event(), threading.Event()

    def stalls(frame):
        if frame.seq > 2:
            stalled.set()
            mended.wait(30)
        return good(frame)

    perception = Perception(Still(), stalls, FakeClock(), 20.0)
    assert stalled.wait(10)
    assert perception.newest().observation.seq == 2  # the last it gave; its age is for the loop to judge
    perception.close()  # nor does the end
    assert not mended.is_set()
    mended.set()
    perception._thread.join(10)
    assert not perception._thread.is_alive()


class Film:
    """A camera whose pictures, taken every 50 ms, come one by one, when they are shown."""

    def __init__(self):
        self.frame = None

    def show(self, seq):
        self.frame = replace(FRAME, seq=seq, t_ns=seq * 50_000_000)

    def read(self, now_ns):
        return self.frame


class Thinking:
    """A segmenter that thinks about each picture until it is let go."""

    def __init__(self):
        self.begun, self.done = threading.Semaphore(0), threading.Semaphore(0)
        self.fails = False

    def __call__(self, frame):
        self.begun.release()
        assert self.done.acquire(timeout=30)
        return replace(good(frame), seq=-1) if self.fails else good(frame)


class Standing(FakeClock):
    """Stands still unless it is advanced."""

    def sleep_until(self, deadline_ns):
        time.sleep(0.001)


@pytest.fixture
def thinking():
    """Perception that has seen two pictures, the second 40 ms late; its camera, segmenter and clock."""
    film, segmenter, clock = Film(), Thinking(), Standing()
    with Perception(film, segmenter, clock, 20.0) as perception:
        for seq, after_s in ((1, 0.05), (2, 0.09)):
            clock.advance(after_s)
            film.show(seq)
            assert segmenter.begun.acquire(timeout=10)
            segmenter.done.release()
            until(lambda seq=seq: (seen := perception.newest()) is not None and seen.frame.seq == seq)
        yield perception, film, segmenter, clock
        segmenter.done.release(10)


def test_an_observation_that_is_due_is_waited_for(thinking):
    perception, film, segmenter, clock = thinking
    clock.advance(0.04)
    film.show(3)
    assert segmenter.begun.acquire(timeout=10)
    threading.Timer(0.05, segmenter.done.release).start()
    assert perception.newest(patience_s=30.0).frame.seq == 3


@pytest.mark.parametrize(
    ("later_s", "patience_s"),
    [(0.02, 30.0), (0.04, 0.01), (0.04, 0.0)],
    ids=["fresh", "impatient", "at once"],
)
def test_nothing_is_waited_for_while_the_last_is_fresh_or_for_longer_than_allowed(
    thinking, later_s, patience_s
):
    perception, film, segmenter, clock = thinking
    film.show(3)
    assert segmenter.begun.acquire(timeout=10)
    clock.advance(later_s)
    begun_s = time.monotonic()
    assert perception.newest(patience_s).frame.seq == 2
    assert time.monotonic() - begun_s < 5.0


def test_nothing_is_waited_for_while_nothing_is_looked_at(thinking):
    perception, _, _, clock = thinking
    clock.advance(0.04)
    assert perception.newest(patience_s=30.0).frame.seq == 2


def test_whoever_waits_learns_of_a_failure(thinking):
    perception, film, segmenter, clock = thinking
    clock.advance(0.04)
    segmenter.fails = True
    film.show(3)
    assert segmenter.begun.acquire(timeout=10)
    threading.Timer(0.05, segmenter.done.release).start()
    with pytest.raises(PlatformError):
        perception.newest(patience_s=30.0)


def test_a_segmenter_that_hung_is_no_other_trials_until_it_returns(monkeypatch):
    monkeypatch.setattr(pipeline, "CLOSE_TIMEOUT_S", 0.05)
    hung, mended = threading.Event(), threading.Event()

    def hangs(frame):
        hung.set()
        mended.wait(30)
        return good(frame)

    refuse_hung(hangs)
    perception = Perception(Still(), hangs, FakeClock(), 20.0)
    assert hung.wait(10)
    perception.close()
    with pytest.raises(PlatformError, match="the segmenter still hangs in a frame of an earlier trial"):
        refuse_hung(hangs)
    refuse_hung(good)
    mended.set()
    perception._thread.join(10)
    refuse_hung(hangs)


def test_a_segmenter_that_did_not_hang_is_the_next_trials():
    with Perception(Still(), good, FakeClock(), 20.0) as perception:
        until(perception.newest)
    refuse_hung(good)


def test_frame_and_observation_come_together():
    with Perception(Still(), good, FakeClock(), 20.0) as perception:
        seen = until(perception.newest)
    assert (seen.frame.seq, seen.frame.t_ns) == (seen.observation.seq, seen.observation.t_ns)


def test_what_was_seen_says_when_it_was_taken_up_and_when_it_was_understood():
    clock = FakeClock()

    class Exposing(Still):
        def read(self, now_ns):
            clock.advance(0.004)
            return super().read(now_ns)

    def thinks(frame):
        clock.advance(0.009)
        return good(frame)

    with Perception(Exposing(), thinks, clock, 20.0) as perception:
        seen = until(perception.newest)
    assert (seen.taken_ns - seen.frame.t_ns, seen.ready_ns - seen.taken_ns) == (4_000_000, 9_000_000)


def test_a_frame_that_was_seen_is_not_segmented_again():
    class Frozen:
        looks = 0

        def read(self, now_ns):
            self.looks += 1
            return FRAME

    camera, seen = Frozen(), []

    def counts(frame):
        seen.append(frame.seq)
        return good(frame)

    with Perception(camera, counts, FakeClock(), 20.0):
        until(lambda: camera.looks > 20)
    assert seen == [FRAME.seq]
