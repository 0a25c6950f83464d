"""The `serve` command: valid requests are answered, all others refused, and an interrupt ends it."""

from __future__ import annotations

import json
import os
import signal
import ssl
import subprocess
import sys
import urllib.request

import numpy as np
import pytest

pytest.importorskip("websockets", reason="needs the extra 'remote'")

from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from adatracker_deploy.cli import main
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.policy.catalogue import DEFAULT, TOKEN, load_policy
from adatracker_deploy.policy.msgpack_numpy import pack, unpack
from adatracker_deploy.policy.server import served
from tests.quadruped.certificates import issue

from .servers import asking, running, seen

PATIENT_S = 20.0
MASK = np.zeros((4, 4), np.uint8)


@pytest.fixture(scope="module")
def pid():
    with running(served(lambda: load_policy("pid"))) as uri:
        yield uri


@pytest.mark.parametrize(
    ("said", "why"),
    [
        (["mask"], "an observation is a map"),
        ({}, "needs a mask"),
        ({"mask": MASK.astype(float)}, "needs a mask"),
        ({"mask": MASK[None]}, "needs a mask"),
        ({"mask": MASK[:0]}, "needs a mask"),
        ({"mask": MASK + np.uint8(9)}, "the class 9: the last is 3"),
        ({"mask": MASK, "box": np.zeros(3)}, "a box is four numbers"),
        ({"mask": MASK, "box": np.full(4, np.nan)}, "a box is four numbers"),
        ({"mask": MASK, "box": [0, 0, 1, 1]}, "a box is four numbers"),
        ({"mask": MASK, "confidence": 2}, "confidence"),
        ({"mask": MASK, "t_ns": 0.5}, "t_ns is a whole number"),
        ({"mask": MASK, "reset": "now"}, "reset is a whole number"),
    ],
)
def test_what_is_no_observation_is_told_and_ends_the_connection(pid, said, why):
    with connect(pid) as client:
        client.recv()
        client.send(pack(said))
        assert why in client.recv()  # text, as openpi's servers send what went wrong
        with pytest.raises(Exception, match="1007"):
            client.recv()


@pytest.mark.parametrize("data", ["text", b"\xc1"])
def test_what_is_no_message_is_told_likewise(pid, data):
    with connect(pid) as client:
        client.recv()
        client.send(data)
        assert "no message" in client.recv()


def test_a_mask_is_enough_and_nothing_is_repeated_that_was_not_said(pid):
    with connect(pid) as client:
        assert set(unpack(client.recv())["adatracker"]["observation"]) == {"mask", "box", "confidence"}
        client.send(pack({"mask": MASK}))
        found = unpack(client.recv())
        assert found.keys() == {"actions", "server_timing"}
        assert found["actions"].shape == (2,)


def test_a_page_in_a_browser_is_not_served(pid):
    with pytest.raises(InvalidStatus, match="403"):
        connect(pid, origin="http://elsewhere.example")


def test_it_says_that_it_lives_to_whoever_asks():
    with running(served(lambda: load_policy("pid"), token="swordfish")) as uri:
        address = uri.replace("ws://", "http://")
        with urllib.request.urlopen(f"{address}/healthz", timeout=10) as answer:
            assert (answer.status, answer.read()) == (200, b"OK\n")


def test_by_tls_and_only_with_a_certificate_that_is_vouched_for(tmp_path, monkeypatch):
    issue("authority", tmp_path)
    issue("server", tmp_path, "authority")
    issue("elsewhere", tmp_path, "authority", place="DNS:elsewhere.local")

    def serving(name):
        return served(
            lambda: load_policy("pid"), certificate=tmp_path / f"{name}.pem", key=tmp_path / f"{name}.key"
        )

    with running(serving("server")) as uri:
        assert uri.startswith("wss://")
        with pytest.raises(UsageError, match=r"cannot be reached: .*certificate verify failed"):
            load_policy(uri)
        with pytest.raises(UsageError, match="cannot be reached"):
            load_policy(uri.replace("wss://", "ws://"))
        monkeypatch.setenv("SSL_CERT_FILE", str(tmp_path / "authority.pem"))
        with asking(uri, patience_s=PATIENT_S) as remote:
            assert remote.act(seen(0)).values.shape == (2,)
    with (
        running(serving("elsewhere")) as uri,
        pytest.raises(UsageError, match=r"cannot be reached: .*(mismatch|not valid for)"),
    ):
        load_policy(uri)
    with running(served(lambda: load_policy("pid"))) as uri, pytest.raises(UsageError, match="cannot be"):
        load_policy(uri.replace("ws://", "wss://"))


def test_by_tls_it_sends_no_tickets_which_would_now_and_then_stop_a_client(tmp_path):
    issue("authority", tmp_path)
    issue("server", tmp_path, "authority")
    server = served(
        lambda: load_policy("pid"), certificate=tmp_path / "server.pem", key=tmp_path / "server.key"
    )
    trusting = ssl.create_default_context(cafile=tmp_path / "authority.pem")
    with running(server) as uri, connect(uri, ssl=trusting) as client:
        client.recv()
        assert client.socket.version() == "TLSv1.3"
        assert not client.socket.session.has_ticket


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--policy", "genius"], "genius"),
        (["--policy", "ws://127.0.0.1:1"], "policies of this machine"),
        (["--certificate", "a.pem"], "--certificate and --key go together"),
        (["--certificate", "no.pem", "--key", "no.key"], "no.pem"),
        (["--host", "192.0.2.1"], "192.0.2.1"),
    ],
)
def test_what_cannot_be_served_is_told_in_a_sentence(capsys, arguments, why):
    assert main(["serve", "--port", "0", *arguments]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert why in said


def test_a_run_with_a_server_that_is_not_there_ends_before_anything_moves(capsys, tmp_path):
    arguments = ["--platform", "wheeled", "--sitl", "--log-dir", str(tmp_path / "trials")]
    assert main([*arguments, "--policy", "ws://127.0.0.1:9"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert main([*arguments, "--policy", "ws://127.0.0.1:9", "--speed", "2"]) == 2
    assert "drop --speed" in capsys.readouterr().err
    assert not (tmp_path / "trials").exists() or not list((tmp_path / "trials").iterdir())


def test_the_command_serves_until_it_is_interrupted_whoever_is_connected():
    command = [sys.executable, "-m", "adatracker_deploy", "serve", "--policy", "pid", "--port", "0"]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {TOKEN: "swordfish"},
    )
    try:
        uri = process.stdout.readline().strip()
        with asking(uri, token="swordfish", patience_s=PATIENT_S) as remote:
            assert remote.act(seen(0)).values.shape == (2,)
            process.send_signal(signal.SIGINT)
            _, err = process.communicate(timeout=20)
    finally:
        process.kill()
        process.communicate()
    assert (process.returncode, err) == (0, "Ctrl-C ends it\n")


def test_evaluations_ask_elsewhere_too_and_find_the_same(capsys):
    with running(served(lambda: load_policy(DEFAULT))) as uri:
        both = ["--policy", DEFAULT, "--policy", uri]  # which call themselves the same
        assert main(["evaluate", *both, "--episodes", "1", "--steps", "20", "--workers", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert found["policies"][uri] == found["policies"][DEFAULT]
