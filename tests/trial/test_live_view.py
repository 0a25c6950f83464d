"""The live view: what a real websocket client is told, and that no client disturbs anything."""

from __future__ import annotations

import base64
import importlib.metadata
import resource
import socket
import struct
from hashlib import sha256
from pathlib import Path
from urllib.parse import parse_qs, urlparse

import numpy as np
import pytest
from mcap.reader import make_reader

from adatracker_deploy.cli import main
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Frame
from adatracker_deploy.trial.live_port import app_url, choose_port, websocket_url
from adatracker_deploy.trial.reader import read_trial
from tests.trial.records import START_NS, TICK_NS, a_log, a_step, an_observation
from tests.trial.test_log import eventually, log_steps

pytest.importorskip("websockets", reason="needs the extra 'live'")

from tests.trial.viewer import Viewer

pytestmark = pytest.mark.slow

TOPICS = {"/step", "/command", "/camera", "/mask", "/box", "/pose", "/log"}


@pytest.fixture
def live(tmp_path):
    """A log that is shown while it is written, and its port."""
    port = choose_port(0)
    with a_log(tmp_path, live_port=port) as log:
        yield log, port


def is_step(number):
    return lambda told: told.topic == "/step" and told.says["step"] == number


def log_and_await(log, viewer, numbers):
    """Log steps, each once the viewer has seen the one before; return the messages of all."""
    told = []
    for number in numbers:
        log_steps(log, [number])
        told += viewer.until(is_step(number))
    return told


def test_a_viewer_is_told_what_the_log_is_told_byte_by_byte(live):
    log, port = live
    with Viewer(port) as viewer:
        log_steps(log, range(5))
        log.event("warning", "the wind freshens", START_NS)
        told = viewer.until(lambda each: each.topic == "/log")
    log.close()
    with (log.folder / "trial.mcap").open("rb") as stream:
        logged = [
            (schema, channel, message)
            for schema, channel, message in make_reader(stream).iter_messages(log_time_order=False)
        ]
    assert [(each.topic, each.time_ns, sha256(each.data).hexdigest()) for each in told] == [
        (channel.topic, message.log_time, sha256(message.data).hexdigest()) for _, channel, message in logged
    ]
    assert {each.topic for each in told} == TOPICS
    offered = {channel["topic"]: channel for channel in viewer.channels}
    assert offered.keys() == TOPICS
    for schema, channel, _ in logged:
        offer = offered[channel.topic]
        assert (offer["schemaName"], offer["encoding"]) == (schema.name, channel.message_encoding)
        assert offer["schemaEncoding"] == schema.encoding
        text = offer["schema"]
        assert schema.data == (base64.b64decode(text) if schema.encoding == "protobuf" else text.encode())


def test_it_offers_nothing_but_looking(live):
    log, port = live
    channel = {"id": 1, "topic": "/command", "encoding": "json", "schemaName": "adatracker.Command"}
    call = struct.pack("<BIII", 2, 1, 1, len(b"json")) + b"json{}"  # opcode, service, call, encoding
    with Viewer(port, topics=()) as viewer:
        assert viewer.info["capabilities"] == []
        for request in (
            {"op": "advertise", "channels": [channel]},
            {"op": "setParameters", "parameters": [{"name": "speed", "value": 9}]},
            {"op": "getParameters", "parameterNames": [], "id": "1"},
            {"op": "subscribeConnectionGraph"},
            {"op": "fetchAsset", "uri": "file:///etc/passwd", "requestId": 1},
        ):
            answer = viewer.ask(**request)
            assert (answer["op"], answer["level"]) == ("status", 2), request
        viewer.websocket.send(call)
        assert viewer.ask()["op"] == "serviceCallFailure"
        log_steps(log, range(3))
    log.close()
    assert len(read_trial(log.folder).steps) == 3
    assert not log.trouble


def a_noisy_frame(number, rng):
    """A picture that JPEG cannot make small: some 0.3 MB."""
    return Frame(rng.integers(0, 256, (480, 640, 3), np.uint8), START_NS + number * TICK_NS, number)


def resident_bytes(pid):
    """Memory of a process's own; the pictures that it shares with the tracker are not counted."""
    (line,) = [line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if "RssAnon" in line]
    return int(line.split()[1]) * 1024


def test_a_viewer_that_never_reads_loses_old_messages_and_costs_nobody_else_any(live, measured):
    log, port = live
    rng = np.random.default_rng(0)
    frames = [a_noisy_frame(number, rng) for number in range(4)]

    def log_one(number):
        frame = frames[number % len(frames)]
        log.step(a_step(number), Frame(frame.rgb, frame.t_ns, number), an_observation(number, 640, 480))

    with Viewer(port, topics={"/step"}) as reader, Viewer(port, receive_bytes=1 << 16) as asleep:
        sizes = []
        last = 160
        for number in range(last):
            log_one(number)
            (told,) = reader.until(lambda each: each.topic == "/step")
            assert told.says["step"] == number  # the one that reads misses nothing
            if number >= 60:
                sizes.append(resident_bytes(log.writer_pid))
        assert (log.dropped, log.frames_dropped, log.trouble) == (0, 0, "")
        grown = max(sizes) - sizes[0]
        assert grown < 10e6  # of 30 MB of pictures
        got = []
        while not got or got[-1] != last - 1:
            told = asleep.next()
            got += [told.says["step"]] if told.topic == "/step" else []
    lost = last - got[0] - len(got)
    assert lost > 80
    assert got == sorted(set(got))
    assert got[-10:] == list(range(last - 10, last))  # it is the oldest that are lost
    log.close()
    assert [step.step for step in read_trial(log.folder).steps] == list(range(last))
    measured(
        f"live view: a client that did not read lost {lost} of {last} steps; the writer grew by {grown} B"
    )


def test_a_viewer_that_never_reads_does_not_hold_up_the_end(live):
    log, port = live
    rng = np.random.default_rng(0)
    with Viewer(port, receive_bytes=1 << 16) as asleep, Viewer(port, topics={"/step"}) as reader:
        for number in range(60):
            frame = a_noisy_frame(number, rng)
            log.step(a_step(number), frame, an_observation(number, 640, 480))
            reader.until(is_step(number))
        log.close({"outcome": "completed"})
        assert not log.trouble
        assert read_trial(log.folder).complete
        asleep.socket.setblocking(False)
        assert asleep.socket.recv(1, socket.MSG_PEEK)  # it was still asleep


def test_viewers_that_come_and_go_leave_nothing_behind(live):
    log, port = live
    process = Path(f"/proc/{log.writer_pid}")

    def held(what):
        return len(list((process / what).iterdir()))

    with Viewer(port, topics={"/step"}) as viewer:  # the library starts some threads for the first
        log_and_await(log, viewer, [0])
        threads, handles = held("task"), held("fd") - 1
    for turn in range(40):
        viewer = Viewer(port)
        log_steps(log, [1 + turn])
        if turn % 2:
            viewer.socket.shutdown(socket.SHUT_RDWR)  # gone without a word
        viewer.close()
        with socket.create_connection(("127.0.0.1", port)) as stranger:
            stranger.sendall(b"GET / HTTP/1.1\r\n\r\n")
    eventually(lambda: held("fd") == handles and held("task") <= threads)
    log.close()
    assert not log.trouble
    assert len(read_trial(log.folder).steps) == 41


def test_on_a_full_disk_the_view_goes_on(live):
    log, port = live
    with Viewer(port, topics={"/step", "/camera"}) as viewer:
        log_and_await(log, viewer, [0])
        full_bytes = (log.folder / "trial.mcap.part").stat().st_size + 1000
        resource.prlimit(log.writer_pid, resource.RLIMIT_FSIZE, (full_bytes, full_bytes))
        log_steps(log, [1])
        eventually(lambda: log.trouble)
        told = log_and_await(log, viewer, range(2, 6))
        assert [each.topic for each in told].count("/camera") == 4


def test_it_listens_on_this_machine_alone(live):
    _, port = live
    listening = [
        line.split()[1].split(":")[0]
        for table in ("/proc/net/tcp", "/proc/net/tcp6")
        for line in Path(table).read_text().splitlines()[1:]
        if int(line.split()[1].rsplit(":", 1)[1], 16) == port and line.split()[3] == "0A"
    ]
    assert listening == ["0100007F"]  # 127.0.0.1 as proc(5) writes it on a little-endian machine


@pytest.fixture
def taken():
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def test_a_port_in_use_is_refused_in_one_line_before_anything_moves(taken, tmp_path, capsys):
    logs = tmp_path / "trials"
    argv = ["--platform", "drone", "--sitl", "--log-dir", str(logs), "--live", str(taken)]
    assert main(argv) == 2
    out, err = capsys.readouterr()
    (line,) = err.splitlines()
    assert f"TCP port {taken} for the live view: Address already in use" in line
    assert "--live PORT" in line
    assert out == ""
    assert not logs.exists()


def test_a_port_that_was_taken_since_is_refused_by_the_writer(taken, tmp_path):
    with pytest.raises(UsageError, match=rf"TCP port {taken} for the live view: .*in use"):
        a_log(tmp_path, live_port=taken)


def test_without_the_extra_one_sentence_says_what_to_install(tmp_path, capsys, monkeypatch):
    def version(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "version", version)
    assert main(["--platform", "drone", "--sitl", "--log-dir", str(tmp_path / "trials"), "--live"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "pip install 'adatracker-deploy[live]'" in line
    assert not (tmp_path / "trials").exists()


def test_what_just_ended_does_not_keep_its_port(tmp_path):
    port = choose_port(0)
    for _ in range(2):
        with a_log(tmp_path, live_port=port) as log, Viewer(port, topics={"/step"}) as viewer:
            log_and_await(log, viewer, [0])
        assert not log.trouble
        assert choose_port(port) == port


def test_the_applications_address_names_the_websocket():
    """As Foxglove's own library gave it."""
    url = urlparse(app_url(8765))
    assert (url.scheme, url.netloc, url.path) == ("https", "app.foxglove.dev", "/")
    assert parse_qs(url.query) == {"ds": ["foxglove-websocket"], "ds.url": ["ws://127.0.0.1:8765"]}
    assert parse_qs(url.query)["ds.url"] == [websocket_url(8765)]
