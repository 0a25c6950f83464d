"""Real routers and sessions on free ports of this machine, and waiting for what they do."""

import socket
import threading
import time
from contextlib import contextmanager

import zenoh

from adatracker_deploy.core.ports import unused_port
from adatracker_quadruped.protocol.session import zenoh_config


def free_port():
    return unused_port(socket.SOCK_STREAM)


def until(condition, timeout_s=5.0):
    """Return the seconds until the condition held."""
    started, never = time.monotonic(), threading.Event()
    while not condition():
        assert time.monotonic() - started < timeout_s, "waited in vain"
        never.wait(0.002)
    return time.monotonic() - started


@contextmanager
def robot(connection, mode="router"):
    with zenoh.open(zenoh_config(connection, mode=mode)) as session:
        yield session


def latest(session, key):
    return session.declare_subscriber(key, zenoh.handlers.RingChannel(1))


def publisher_of(session, key):
    """Return a publisher that drops nothing."""
    return session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)


def arrives(publisher, subscriber, payload):
    """Publish once the subscriber is known; return what it gets."""
    until(lambda: publisher.matching_status.matching)
    publisher.put(payload)
    got = []
    until(lambda: got.append(subscriber.try_recv()) or got[-1] is not None)
    return got[-1].payload.to_bytes()
