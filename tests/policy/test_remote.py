"""A policy on another machine drives as the same one here, and what it says is judged before it is obeyed."""

from __future__ import annotations

import contextlib
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("websockets", reason="needs the extra 'remote'")

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import PlatformState, Twist
from adatracker_deploy.evaluation.grid import Grid
from adatracker_deploy.evaluation.play import play
from adatracker_deploy.policy import remote as module
from adatracker_deploy.policy.base import NoAnswer
from adatracker_deploy.policy.catalogue import DEFAULT, load_policy
from adatracker_deploy.policy.remote import RemotePolicy
from adatracker_deploy.policy.server import served

from .servers import MANIFEST, PERIOD_NS, asking, running, saying, seen

pytestmark = pytest.mark.realtime

PATIENT_S = 20.0


class Noting:
    """A policy that notes what it is shown."""

    def __init__(self, whole):
        self.info, self.reset, self._whole, self.shown = whole.info, whole.reset, whole, []

    def act(self, observation):
        self.shown.append((observation.mask, observation.box, observation.confidence, observation.t_ns))
        return self._whole.act(observation)


def test_a_bundle_elsewhere_answers_as_the_same_bundle_here():
    here = load_policy(DEFAULT)
    with (
        running(served(lambda: load_policy(DEFAULT))) as uri,
        asking(uri, patience_s=PATIENT_S) as there,
    ):
        assert replace(there.info, server="") == here.info  # the digests too
        assert there.info.server == uri
        for episode in (3, 4):
            here.reset(episode)
            there.reset(episode)
            searched = []
            for seq in range(60):
                now = seen(seq) if seq < 20 else replace(seen(seq), mask=np.zeros((48, 64), np.uint8))
                ours, theirs = here.act(now), there.act(now)
                np.testing.assert_allclose(theirs.values, ours.values, atol=1e-6)
                np.testing.assert_allclose(theirs.context, ours.context, atol=1e-6)
                assert theirs.searching is ours.searching
                searched.append(ours.searching)
                assert not ours.searching or ours.values.tolist() in ([0, 1], [0, -1])
            assert searched == sorted(searched)  # once the target has gone, and until it comes back
            assert (searched[20], searched[-1]) == (False, True)


def test_a_whole_episode_is_the_same_here_and_elsewhere():
    """Shown the same to the bit, it answers the same within 1e-6, and so the robot goes the same way."""
    here, servers = Noting(load_policy(DEFAULT)), []

    def load():
        servers.append(Noting(load_policy(DEFAULT)))
        return servers[-1]

    episode = Grid(policies=(DEFAULT,), episodes=1, steps=60).plan()[0]
    ours = play(here, episode)
    with running(served(load)) as uri, asking(uri, patience_s=PATIENT_S) as there:
        theirs = play(there, episode)
    shown = servers[-1].shown[-len(here.shown) :]  # after what was asked before the start
    assert len(here.shown) == 60
    for (mask, box, *rest), (mask_there, box_there, *rest_there) in zip(here.shown, shown, strict=True):
        np.testing.assert_array_equal(mask_there, mask)
        assert rest_there == rest
        assert (box is None) == (box_there is None)
        if box is not None:
            sides = [(each.cx, each.cy, each.w, each.h) for each in (box, box_there)]
            np.testing.assert_allclose(*sides, atol=1e-7)
    assert theirs == ours


def test_two_robots_do_not_share_what_a_policy_remembers():
    with (
        running(served(lambda: load_policy(DEFAULT))) as uri,
        asking(uri, patience_s=PATIENT_S) as one,
        asking(uri, patience_s=PATIENT_S) as other,
    ):
        for seq in range(5):
            one.act(seen(seq))
        fresh = load_policy(DEFAULT)
        np.testing.assert_allclose(other.act(seen(9)).values, fresh.act(seen(9)).values, atol=1e-6)


def test_a_server_is_told_what_it_asks_for_and_nothing_else():
    state = PlatformState(7, "GO", pose=Pose(1.0, 2.0), velocity=Twist(0.5, yaw_rate=-0.25), battery=0.75)
    with saying(lambda message, _: {"actions": np.zeros(2, np.float32)}) as (uri, heard):
        with asking(uri, prompt="the man in red", patience_s=PATIENT_S) as remote:
            remote.reset(7)
            remote.act(replace(seen(1), state=state))
            remote.act(seen(2))
        first, second = heard
        assert first.keys() == {"request", "seq", "t_ns", "reset", *MANIFEST["observation"]}
        assert second.keys() == first.keys() - {"reset"}
        assert (first["reset"], first["prompt"], first["seq"]) == (7, "the man in red", 1)
        np.testing.assert_array_equal(first["mask"], seen(1).mask)
        np.testing.assert_array_equal(first["image"], seen(1).image)
        np.testing.assert_array_equal(first["state"]["velocity"], np.float32([0.5, 0, 0, -0.25]))
        np.testing.assert_array_equal(first["state"]["pose"], np.float32([1, 2, 0, 0, 0, 0]))
        assert (first["state"]["battery"], first["state"]["t_ns"], second["state"]) == (0.75, 7, None)
    only = MANIFEST | {"observation": ["box"]}
    with saying(lambda message, _: {"actions": np.zeros(2)}, only) as (uri, heard):
        with asking(uri, patience_s=PATIENT_S) as remote:
            remote.act(seen(1))
        assert heard[0].keys() == {"request", "seq", "t_ns", "reset", "box"}


def test_a_server_that_wants_pictures_is_not_asked_without_them():
    with saying(lambda message, _: {"actions": np.zeros(2)}) as (uri, heard), asking(uri) as remote:
        with pytest.raises(UsageError, match="needs the camera's picture"):
            remote.act(replace(seen(1), image=None))
        assert not heard


def test_a_chunk_is_played_by_the_time_of_pictures_and_its_last_row_is_held():
    rows = np.array([[0.1, 0.0], [0.2, 0.0], [0.3, 0.0]], np.float32)
    gate = threading.Event()

    def once(message, number):
        if number:
            gate.wait(PATIENT_S)
        return {"actions": rows, "server_timing": {"infer_ms": 12.5}}

    with saying(once) as (uri, _), asking(uri) as remote:
        first = until_answered(remote, seen(0))
        assert first.values[0] == np.float32(0.1)
        played = [remote.act(seen(seq)) for seq in range(1, 5)]
        gate.set()
    assert [float(action.values[0]) for action in played] == pytest.approx([0.2, 0.3, 0.3, 0.3])
    assert {action.answer.t_ns for action in (first, *played)} == {0}  # for loop and gate to judge
    assert first.answer.server_ms == 12.5
    assert 0 <= first.answer.queue_ms < first.answer.queue_ms + first.answer.round_trip_ms < 60_000


def until_answered(remote, observation):
    """The first answer; on a busy machine it may miss its own tick."""
    began_s = time.monotonic()
    while True:
        with contextlib.suppress(NoAnswer):
            return remote.act(observation)
        assert time.monotonic() - began_s < PATIENT_S


@pytest.mark.parametrize("delay_s", [0.08, 0.3])
def test_a_slow_server_never_makes_a_tick_wait_for_more_than_half_a_period(delay_s):
    def slowly(message, number):
        time.sleep(delay_s)
        return {"actions": np.ones(2)}

    with saying(slowly) as (uri, _), asking(uri) as remote:
        for seq in range(5):
            began_s = time.monotonic()
            with contextlib.suppress(NoAnswer):
                remote.act(seen(seq))
            assert time.monotonic() - began_s < 0.5  # 0.05 s, and what a busy machine adds


def test_an_answer_is_of_the_picture_that_it_answers_however_late_it_comes():
    held = threading.Event()

    def late(message, number):
        held.wait(PATIENT_S)
        return {"actions": np.full(2, message["seq"] / 100)}

    with saying(late) as (uri, _), asking(uri) as remote:
        with pytest.raises(NoAnswer):
            remote.act(seen(0))
        held.set()
        for seq in range(1, 20):
            with contextlib.suppress(NoAnswer):
                action = remote.act(seen(seq))
                assert action.values[0] == pytest.approx(action.answer.t_ns / PERIOD_NS / 100)


def test_answers_in_another_order_do_not_bring_an_older_one_back(monkeypatch):
    monkeypatch.setattr(module, "STALE_OBSERVATION_S", 0.05)  # it asks on without an answer after so long
    held = []

    def swapped(message, number):
        held.append({"actions": np.full(2, message["seq"] / 100), "request": message["request"]})
        if len(held) < 2:
            return None
        two, held[:] = held[::-1], []
        return two

    with saying(swapped) as (uri, heard), asking(uri) as remote:
        acted = []
        for seq in range(40):
            with contextlib.suppress(NoAnswer):
                acted.append(remote.act(seen(seq)))
        assert len(heard) >= 4
    times_ns = [action.answer.t_ns for action in acted]
    assert times_ns == sorted(times_ns)
    assert acted
    for action in acted:
        assert action.values[0] == pytest.approx(action.answer.t_ns / PERIOD_NS / 100)


def test_without_numbers_in_its_answers_a_server_is_asked_one_thing_at_a_time(monkeypatch):
    """As openpi's own client does: else nobody could tell which answer is whose."""
    monkeypatch.setattr(module, "STALE_OBSERVATION_S", 0.05)

    def twice(message, number):
        return {"actions": np.ones(2)} if number < 2 else None

    with saying(twice, repeats=False) as (uri, heard), asking(uri) as remote:
        for seq in range(20):
            with contextlib.suppress(NoAnswer):
                remote.act(seen(seq))
        assert len(heard) == 3


def test_an_episode_knows_nothing_of_the_one_before():
    held = threading.Event()

    def first_late(message, number):
        if number == 0:
            held.wait(PATIENT_S)
        return {"actions": np.full(2, number)}

    with saying(first_late) as (uri, heard), asking(uri) as remote:
        remote.reset(1)
        with pytest.raises(NoAnswer):
            remote.act(seen(0))
        remote.reset(2)
        held.set()
        action = until_answered(remote, seen(1))
        assert action.values[0] > 0  # the late one was of the first episode
        assert [message.get("reset") for message in heard[:2]] == [1, 2]


def test_a_server_that_goes_ends_the_trial_and_the_next_one_does_not_begin():
    with running(served(lambda: load_policy("pid"))) as uri:
        remote = RemotePolicy(uri, patience_s=PATIENT_S)
        remote.act(seen(0))
        remote.check()
    with contextlib.closing(remote):
        with pytest.raises(PlatformError, match="the server is gone"):
            remote.check()
        with pytest.raises(PlatformError, match=r"policy ws://127.*: the server is gone"):
            remote.act(seen(1))


def test_a_server_that_reads_nothing_holds_up_neither_a_tick_nor_the_end(monkeypatch):
    """Pictures fill its socket's buffer, and the thread that sends them hangs."""
    over = threading.Event()

    def deaf(message, number):
        over.wait(60)

    monkeypatch.setattr(module, "STALE_OBSERVATION_S", 0.01)
    big = replace(seen(0), image=np.zeros((1080, 1920, 3), np.uint8))
    with saying(deaf) as (uri, _):
        remote = RemotePolicy(uri)
        for _ in range(20):
            began_s = time.monotonic()
            with contextlib.suppress(NoAnswer):
                remote.act(big)
            assert time.monotonic() - began_s < 1.0
        began_s = time.monotonic()
        remote.close()
        assert time.monotonic() - began_s < 5.0
        over.set()


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ({"actions": np.zeros(3)}, r"actions of shape \(3,\): expected \(2,\)"),
        ({"actions": np.zeros((0, 2))}, "actions of shape"),
        ({"actions": np.zeros((4, 2, 2))}, "without actions"),
        ({"actions": np.zeros((5000, 2))}, "actions of shape"),
        ({"actions": [0.0, 1.0]}, "without actions"),
        ({"actions": np.zeros(2, bool)}, "without actions"),
        ({"actions": np.zeros(2), "context": np.zeros((2, 2))}, "a context"),
        ({"actions": np.zeros(2), "request": 10**6}, "answers request 1000000, which was not made"),
        ({"actions": np.zeros(2), "request": "1"}, "request is not a number"),
        ({"actions": np.zeros(2), "request": None}, "answers request None"),
        ({}, "without actions"),
        ([["actions"]], "without actions"),
        (b"\xc1", "no message"),
        ("Traceback ...\nValueError: no such key 'mask'\n", "the server failed: ValueError: no such key"),
        ("\x1b[31mred", r"the server failed: \?\[31mred"),
    ],
    ids=[
        *("too many", "no rows", "three dimensions", "too long", "no array", "bool", "a bad context"),
        *("another's", "text for a number", "no number", "nothing", "a list", "rubbish", "a traceback"),
        "escape codes",
    ],
)
def test_an_answer_that_is_no_action_ends_the_trial_with_a_sentence(said, why):
    with (
        saying(lambda message, number: said) as (uri, _),
        asking(uri, patience_s=PATIENT_S) as remote,
        pytest.raises(PlatformError, match=why),
    ):
        remote.act(seen(1))


def test_a_message_without_end_is_not_taken_in(monkeypatch):
    monkeypatch.setattr(module, "LARGEST_BYTES", 1 << 16)
    with (
        saying(lambda message, number: bytes(1 << 17)) as (uri, _),
        asking(uri, patience_s=PATIENT_S) as remote,
        pytest.raises(PlatformError, match="the server is gone"),
    ):
        remote.act(seen(1))
