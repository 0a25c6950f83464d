"""openpi's own client talks to `serve`; a server with openpi's behaviour on the wire drives through us.

The client is the package `openpi-client`, left out where it is not installed (its numpy < 2 is not ours:
``pip install --no-deps openpi-client msgpack``). Its server is published as source alone, not as a package:
`OpenpiServer` here does on the wire what its WebsocketPolicyServer does.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
import socket
import subprocess
import sys
import threading
import time
import traceback
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("websockets", reason="needs the extra 'remote'")

from websockets.asyncio.server import serve
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.ports import unused_port
from adatracker_deploy.policy.catalogue import DEFAULT, load_policy
from adatracker_deploy.policy.msgpack_numpy import pack, unpack
from adatracker_deploy.policy.server import served

from .servers import MANIFEST, asking, running, seen

PATIENT_S = 20.0


class OpenpiServer:
    """Metadata first, then one answer after the other; a failure is sent as text and ends the connection."""

    def __init__(self, infer, metadata, pack, unpack):
        self._infer, self._metadata, self._pack, self._unpack = infer, metadata, pack, unpack

    async def converse(self, websocket):
        await websocket.send(self._pack(self._metadata))
        previous_s = None
        while True:
            try:
                began_s = time.monotonic()
                observation = self._unpack(await websocket.recv())
                infer_s = time.monotonic()
                action = self._infer(observation)
                action["server_timing"] = {"infer_ms": (time.monotonic() - infer_s) * 1e3}
                if previous_s is not None:
                    action["server_timing"]["prev_total_ms"] = previous_s * 1e3
                await websocket.send(self._pack(action))
                previous_s = time.monotonic() - began_s
            except ConnectionClosed:
                return
            except Exception:
                await websocket.send(traceback.format_exc())
                await websocket.close(CloseCode.INTERNAL_ERROR, "Internal server error.")
                return

    @contextlib.contextmanager
    def running(self):
        loop, ready, address = asyncio.new_event_loop(), threading.Event(), []

        async def whole():
            self._over = asyncio.Event()
            options = {"compression": None, "max_size": None}
            async with serve(self.converse, "127.0.0.1", 0, **options) as server:
                address.append(server.sockets[0].getsockname())
                ready.set()
                await self._over.wait()

        thread = threading.Thread(target=lambda: loop.run_until_complete(whole()), daemon=True)
        thread.start()
        assert ready.wait(PATIENT_S)
        yield "ws://{}:{}".format(*address[0])
        loop.call_soon_threadsafe(self._over.set)
        thread.join(PATIENT_S)
        loop.close()


def test_openpis_client_is_answered_as_our_own():
    client = pytest.importorskip(
        "openpi_client.websocket_client_policy", reason="openpi-client: not installed"
    )
    here = load_policy(DEFAULT)
    with running(served(lambda: load_policy(DEFAULT), token="swordfish")) as uri:
        there = client.WebsocketClientPolicy(uri, api_key="swordfish")
        metadata = there.get_server_metadata()["adatracker"]
        assert (metadata["name"], metadata["rate_hz"]) == (here.info.name, here.info.rate_hz)
        for seq in range(10):
            answer = there.infer(
                {"mask": seen(seq).mask, "prompt": "follow the person", "state": np.zeros(3)}
            )
            np.testing.assert_allclose(answer["actions"], here.act(seen(seq)).values, atol=1e-6)
            assert answer["server_timing"]["infer_ms"] > 0
        with pytest.raises(RuntimeError, match="needs a mask"):
            there.infer({"image": seen(0).image})


def test_the_example_of_the_documentation_drives():
    pytest.importorskip("openpi_client.msgpack_numpy", reason="openpi-client: not installed")
    page = (Path(__file__).parents[2] / "docs" / "remote.md").read_text()
    (example,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    port = free_port()
    assert example.count("8000") == 1
    process = subprocess.Popen([sys.executable, "-c", example.replace("8000", str(port))])
    try:
        wait_for(port)
        with asking(f"ws://127.0.0.1:{port}", patience_s=PATIENT_S) as remote:
            assert remote.info.action[0].unit == "si"
            assert remote.act(seen(0)).values == pytest.approx([0, 0])
    finally:
        process.kill()
        process.wait()


def wait_for(port):
    end_s = time.monotonic() + PATIENT_S
    while True:
        try:
            socket.create_connection(("127.0.0.1", port)).close()
        except ConnectionRefusedError:
            assert time.monotonic() < end_s
            time.sleep(0.02)
        else:
            return


def free_port():
    return unused_port(socket.SOCK_STREAM)


def packers():
    yield pytest.param(pack, unpack, id="our MessagePack")
    try:
        from openpi_client import msgpack_numpy
    except ImportError:
        reason = pytest.mark.skip(reason="openpi-client: not installed")
        yield pytest.param(None, None, id="openpi's MessagePack", marks=reason)
    else:
        yield pytest.param(msgpack_numpy.packb, msgpack_numpy.unpackb, id="openpi's MessagePack")


@pytest.mark.parametrize(("packs", "unpacks"), list(packers()))
def test_a_server_as_openpis_drives_through_us(packs, unpacks):
    shown = []

    def infer(observation):
        shown.append(observation)
        return {
            "actions": np.full((8, 2), observation["confidence"], np.float64),
            "state": observation["state"],
        }

    metadata = {"adatracker": MANIFEST, "reset_pose": [0.0]}
    with OpenpiServer(infer, metadata, packs, unpacks).running() as uri:
        with asking(uri, prompt="follow", patience_s=PATIENT_S) as remote:
            for seq in range(5):
                action = remote.act(seen(seq))
                assert action.values == pytest.approx([0.5, 0.5])
                assert action.answer.server_ms >= 0
        np.testing.assert_array_equal(shown[-1]["image"], seen(4).image)
        assert shown[-1]["prompt"] == "follow"


def test_its_traceback_ends_the_trial_with_its_last_line():
    def infer(observation):
        if observation["request"] > 0:
            raise KeyError("observation/wrist_image")
        return {"actions": np.zeros((8, 2))}

    server = OpenpiServer(infer, {"adatracker": MANIFEST}, pack, unpack)
    with (
        server.running() as uri,
        asking(uri, patience_s=PATIENT_S) as remote,
        pytest.raises(PlatformError, match="the server failed: KeyError: 'observation/wrist_image'"),
    ):
        remote.act(seen(0))
