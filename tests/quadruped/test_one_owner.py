"""One owner for each robot: whoever comes second is refused, whoever comes at the same moment too."""

import contextlib
import dataclasses
import time

import pytest
import zenoh

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import Twist
from adatracker_quadruped.adapter.lease import SETTLE_S, Lease
from adatracker_quadruped.platform import QuadrupedPlatform
from adatracker_quadruped.protocol.connection import Connection
from adatracker_quadruped.protocol.keys import Keys
from adatracker_quadruped.protocol.session import open_session
from tests.driving import engages, send_for
from tests.quadruped.rehearsal import connected, simulator
from tests.quadruped.routers import free_port, robot, until
from tests.race import owners, race
from tests.tiers import EXHAUSTIVE

pytestmark = pytest.mark.slow

TOKEN = "adatracker/host"


@contextlib.contextmanager
def hosts(count):
    """Sessions of so many hosts at one router, sorted by their ids, and the router's own."""
    connection = Connection(endpoint=f"tcp/127.0.0.1:{free_port()}")
    with robot(connection) as router, contextlib.ExitStack() as stack:
        sessions = [stack.enter_context(open_session(connection)) for _ in range(count)]
        yield sorted(sessions, key=lambda session: str(session.zid())), router


@pytest.fixture
def seen():
    """Two hosts that can claim, the one with the smaller id first, and what the robot sees of their token."""
    with hosts(2) as (sessions, router):
        changes = router.liveliness().declare_subscriber(TOKEN, zenoh.handlers.FifoChannel(64), history=True)
        yield (*(Lease(session, TOKEN) for session in sessions), changes)


def kinds(changes):
    return [change.kind for change in iter(changes.try_recv, None)]


@pytest.mark.parametrize("older", [0, 1])
def test_the_older_owner_keeps_the_robot_whatever_the_ids(seen, older):
    owner, newcomer = seen[older], seen[1 - older]
    begun_s = time.monotonic()
    assert owner.take()
    assert time.monotonic() - begun_s < SETTLE_S + 0.3
    assert not newcomer.take()
    assert owner.owned
    assert owner.lost() == ""
    owner.release()
    assert newcomer.take()


def test_the_robot_sees_the_owners_token_go_and_never_that_of_a_newcomer(seen):
    first, second, changes = seen
    assert first.take()
    until(lambda: zenoh.SampleKind.PUT in kinds(changes))
    assert not second.take()
    assert kinds(changes) == []
    first.release()
    until(lambda: zenoh.SampleKind.DELETE in kinds(changes))


def test_a_host_that_knows_only_the_plain_token_is_an_owner_too():
    with hosts(2) as ((first, second), _):
        plain = second.liveliness().declare_token(TOKEN)
        lease = Lease(first, TOKEN)
        assert not lease.take()
        plain.undeclare()
        assert lease.take()


def test_of_two_claims_the_one_with_the_smaller_id_wins():
    with hosts(3) as ((smaller, own, larger), _):
        lease = Lease(own, TOKEN)
        rival = larger.liveliness().declare_token(f"{TOKEN}/claim/{larger.zid()}")
        assert lease.take()
        lease.release()
        rival.undeclare()
        rival = smaller.liveliness().declare_token(f"{TOKEN}/claim/{smaller.zid()}")
        assert not lease.take()
        rival.undeclare()


def test_of_two_owners_the_one_with_the_larger_id_has_lost():
    with hosts(3) as ((smaller, own, larger), _):
        lease = Lease(own, TOKEN)
        assert lease.take()
        owners = [one.liveliness().declare_token(f"{TOKEN}/owner/{one.zid()}") for one in (larger, smaller)]
        until(lease.lost)
        for owner in owners:
            owner.undeclare()


def test_an_owner_with_the_smaller_id_stays_one():
    with hosts(2) as ((own, larger), _):
        lease = Lease(own, TOKEN)
        assert lease.take()
        owner = larger.liveliness().declare_token(f"{TOKEN}/owner/{larger.zid()}")
        until(lambda: any("/owner/" in key for key in lease._look()))
        assert lease.lost() == ""
        owner.undeclare()


def test_a_claim_that_is_given_up_ends_at_once_and_leaves_nothing(seen):
    first, second, _ = seen
    begun_s = time.monotonic()
    assert not first.take(lambda: True)
    assert time.monotonic() - begun_s < SETTLE_S / 2
    assert second.take()


def test_a_second_owner_that_appears_while_walking_latches_and_an_engage_is_refused():
    with (
        simulator() as (_, profile),
        connected(profile) as platform,
        open_session(profile.connection) as session,
    ):
        platform.engage()
        send_for(platform, Twist(vx=0.5), 0.5)
        token = session.liveliness().declare_token(f"{TOKEN}/owner/0")
        with pytest.raises(PlatformError, match="another host owns adatracker/host too"):
            send_for(platform, Twist(vx=0.5), 2.0)
        with pytest.raises(PlatformError, match="another host holds adatracker/host: end it first"):
            platform.engage()
        keys = Keys(profile.connection)
        heard = session.declare_subscriber(keys.command, zenoh.handlers.FifoChannel(64))
        platform.hold("too late")
        platform.disengage()
        assert heard.try_recv() is None
        heard.undeclare()
        token.undeclare()
        until(lambda: engages(platform))


def test_one_robot_has_one_adapter_on_a_machine_until_it_is_closed():
    with (
        simulator() as (_, profile),
        connected(profile) as first,
        QuadrupedPlatform(profile, MonotonicClock()) as second,
    ):
        with pytest.raises(PlatformError, match="is driven by another program on this machine"):
            second.connect()
        first.close()
        second.connect()


@pytest.mark.parametrize(
    "elsewhere", [(), pytest.param(("--elsewhere",), marks=EXHAUSTIVE)], ids=["one machine", "two machines"]
)
def test_of_two_that_start_at_once_exactly_one_has_the_robot(elsewhere, measured, exhaustive):
    with simulator() as (_, profile):
        own = dataclasses.asdict(profile.connection)
        connection = {name: own[name] for name in ("endpoint", "rehearsal_token", "camera_topic")}
        results = race("quadruped", connection, *elsewhere, starts=50 if exhaustive else 5)
    counts = [len(owners(result)) for result in results]
    where = "on two machines" if elsewhere else "on one machine"
    measured(
        f"two starts at once for a quadruped, {where}: {counts.count(1)} of {len(counts)} with one owner"
    )
    assert counts == [1] * len(results), results
    assert all("another" in said for result in results for said in result if said != "owner")
