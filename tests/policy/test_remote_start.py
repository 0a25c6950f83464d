"""A server that cannot serve a policy for a robot is refused in one sentence, before anything moves."""

from __future__ import annotations

import contextlib
import socket
import ssl
import threading
import time

import numpy as np
import pytest

pytest.importorskip("websockets", reason="needs the extra 'remote'")

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.policy import remote as module
from adatracker_deploy.policy.base import ActionAxis, PolicyInfo
from adatracker_deploy.policy.catalogue import TOKEN, load_policy
from adatracker_deploy.policy.contract import KEY, read_contract, written
from adatracker_deploy.policy.msgpack_numpy import pack, unpack
from adatracker_deploy.policy.remote import RemotePolicy
from adatracker_deploy.policy.server import served
from tests.quadruped.certificates import issue

from .servers import MANIFEST, asking, running, saying, seen

pytestmark = pytest.mark.realtime

PATIENT_S = 20.0


@pytest.mark.parametrize(
    ("manifest", "why"),
    [
        (None, "lacks a contract"),
        ({}, "missing key"),
        (MANIFEST | {"rate_hz": 0.5}, "rate_hz"),
        (MANIFEST | {"name": "\x1b[31m"}, "printable"),
        (MANIFEST | {"runs_on": "\x1b[31m"}, "printable"),
        (MANIFEST | {"action": []}, "at least one axis"),
        (MANIFEST | {"action": [{"axis": "yaw"}, {"axis": "yaw"}]}, "none twice"),
        (MANIFEST | {"action": [{"axis": "sideways"}]}, "axis"),
        (MANIFEST | {"action": [{"axis": "yaw", "unit": "degrees"}]}, "unit"),
        (MANIFEST | {"observation": ["lidar"]}, "observation"),
    ],
)
def test_a_server_that_does_not_say_what_it_drives_is_refused(manifest, why):
    with saying(lambda message, number: None, manifest) as (uri, _), pytest.raises(UsageError, match=why):
        RemotePolicy(uri)


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        ({"actions": np.full(2, np.nan)}, "blank picture is not finite"),
        ({"actions": np.zeros(3)}, "actions of shape"),
        ("ValueError: a 224 x 224 picture is expected", "the server failed: ValueError: a 224"),
        (None, "no answer within 0.5 s"),
    ],
    ids=["NaN", "too many", "a failure", "none"],
)
def test_what_it_answers_is_tried_before_anything_moves(monkeypatch, answer, why):
    monkeypatch.setattr(module, "FIRST_S", 0.5)
    monkeypatch.setattr("tests.policy.servers.Saying.__call__", blunt(answer))
    with saying(None) as (uri, _), pytest.raises(UsageError, match=why):
        RemotePolicy(uri)


def blunt(answer):
    """A server that answers everything alike, also what is asked before the start."""

    def call(self, connection):
        self.answers = answer
        connection.send(pack({"adatracker": self.manifest}))
        for data in connection:
            self._send(connection, answer, unpack(data))

    return call


def test_a_server_that_is_too_slow_for_any_robot_is_refused_but_may_be_evaluated():
    def load():
        policy = load_policy("pid")
        act = policy.act
        policy.act = lambda observation: (time.sleep(0.3), act(observation))[1]
        return policy

    with running(served(load)) as uri:
        with pytest.raises(UsageError, match=r"answers after 0\.\d\d s; pictures older than 0.22 s"):
            RemotePolicy(uri)
        with asking(uri, patience_s=PATIENT_S) as remote:
            assert remote.act(seen(0)).values.shape == (2,)


def test_what_a_policy_says_of_itself_is_read_as_it_was_written():
    spec = (ActionAxis(axis="forward", unit="si"), ActionAxis(axis="yaw", sign=-1))
    info = PolicyInfo(name="far", rate_hz=12.5, action=spec, sha256=(("a.onnx", "00ff"),))
    said = unpack(pack(written(info, ("image", "state")) | {"reset_pose": [0.0]}))
    said[KEY]["of a later version"] = 1
    contract = read_contract(said)
    assert contract.info("") == info
    assert contract.observation == ("image", "state")


def test_nobody_there_is_one_sentence():
    with running(served(lambda: load_policy("pid"))) as uri:
        pass
    with pytest.raises(UsageError, match=r"^policy ws://127.*: cannot be reached: .*refused"):
        RemotePolicy(uri)


@pytest.mark.parametrize(
    ("scheme", "says", "why"),
    [
        ("ws", b"", "cannot be reached: timed out"),
        ("wss", b"", "cannot be reached: .*timed out"),
        ("ws", b"SSH-2.0-OpenSSH_9.6\r\n", "cannot be reached"),
        ("wss", b"SSH-2.0-OpenSSH_9.6\r\n", "cannot be reached"),
        ("ws", b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n", "cannot be reached: .*404"),
    ],
    ids=["silence", "silence under TLS", "SSH", "SSH for TLS", "a web server"],
)
def test_somebody_else_there_is_one_sentence(monkeypatch, scheme, says, why):
    monkeypatch.setattr(module, "CONNECT_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def speak():
            with contextlib.suppress(OSError):
                connection, _ = listening.accept()
                with connection:
                    if says.startswith(b"HTTP"):
                        connection.recv(4096)
                    connection.sendall(says)
                    while connection.recv(4096):
                        pass

        thread = threading.Thread(target=speak, daemon=True)
        thread.start()
        with pytest.raises(UsageError, match=why) as raised:
            RemotePolicy("{}://somebody:secret@{}:{}".format(scheme, *listening.getsockname()))
        assert "secret" not in str(raised.value)
        thread.join(10)


def test_a_server_that_falls_silent_after_its_tls_is_one_sentence(monkeypatch, tmp_path):
    """It sends its session tickets, if it has any, and then nothing more."""
    monkeypatch.setattr(module, "CONNECT_S", 0.5)
    issue("authority", tmp_path)
    issue("server", tmp_path, "authority")
    monkeypatch.setenv("SSL_CERT_FILE", str(tmp_path / "authority.pem"))
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(tmp_path / "server.pem", tmp_path / "server.key")
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def listen():
            with context.wrap_socket(listening.accept()[0], server_side=True) as connection:
                while connection.recv(4096):
                    pass

        thread = threading.Thread(target=listen, daemon=True)
        thread.start()
        with pytest.raises(UsageError, match="cannot be reached: timed out"):
            RemotePolicy("wss://{}:{}".format(*listening.getsockname()))
        thread.join(10)
        assert not thread.is_alive()


def test_a_server_that_says_nothing_of_itself_is_one_sentence(monkeypatch):
    from websockets.sync.server import serve

    monkeypatch.setattr(module, "CONNECT_S", 0.5)
    silent = serve(lambda connection: connection.recv(), "127.0.0.1", 0, close_timeout=1)
    with running(silent) as uri, pytest.raises(UsageError, match=r"sends no metadata for 0\.5 s"):
        RemotePolicy(uri)


def test_without_the_token_nobody_is_served(monkeypatch):
    with running(served(lambda: load_policy("pid"), token="swordfish")) as uri:
        for wrong in ("", "sword"):
            monkeypatch.setenv(TOKEN, wrong)
            with pytest.raises(UsageError, match=r"cannot be reached: .*401"):
                load_policy(uri)
        monkeypatch.setenv(TOKEN, "swordfish")
        with contextlib.closing(load_policy(uri)) as remote:
            assert remote.act(seen(0)).values.shape == (2,)
