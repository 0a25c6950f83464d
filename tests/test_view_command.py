"""``view``: every frame of a film, a live camera in a browser, and wrong requests in one line."""

from __future__ import annotations

import contextlib
import json
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from adatracker_deploy.app.view_page import ViewPage
from adatracker_deploy.app.view_run import Viewed, Viewer
from adatracker_deploy.cli import main
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Action, Box, Frame, Observation, TargetState, Truth
from adatracker_deploy.core.ports import unused_port
from adatracker_deploy.page.address import Address
from adatracker_deploy.perception.capture import Capture
from adatracker_deploy.perception.mjpeg_server import MjpegServer
from adatracker_deploy.policy.base import ActionAxis, PolicyInfo
from tests.page.browsing import Browser
from tests.tiers import EXHAUSTIVE

pytestmark = pytest.mark.slow

PERIOD_NS = 100_000_000


def picture(number):
    return np.full((48, 64, 3), 10 * number, np.uint8)


@pytest.fixture
def pictures(tmp_path):
    """A folder of twelve pictures in which there is nobody."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    for number in range(1, 13):
        cv2.imwrite(str(folder / f"{number}.png"), picture(number))
    return folder


# The viewer


class Scripted:
    """A segmenter that says what a test wants of each frame."""

    def __init__(self, states):
        self._states = iter(states)

    needs_truth = False

    def reset(self):
        pass

    def __call__(self, frame):
        state = next(self._states)
        seen = state in (TargetState.TRACKED, TargetState.REACQUIRED)
        box = Box(0.5, 0.5, 0.2, 0.2) if seen else None
        return Observation(np.zeros((8, 8), np.uint8), box, 0.5, frame.t_ns, frame.seq, state)


class Backwards:
    """A policy whose numbers mean right and back."""

    info = PolicyInfo(
        name="backwards", rate_hz=10.0, action=(ActionAxis(axis="yaw", sign=-1), ActionAxis(axis="forward"))
    )

    def reset(self, seed=0):
        pass

    def act(self, observation):
        return Action(np.array([0.25, -0.5], np.float32))


def looked(states, policy=None):
    viewer = Viewer(Scripted(states), policy)
    seen = [
        viewer.look(Frame(picture(1), number * PERIOD_NS, number)) for number in range(1, len(states) + 1)
    ]
    return viewer, seen


def test_what_was_seen_is_counted_by_its_state():
    tracked, coasting, lost = TargetState.TRACKED, TargetState.COASTING, TargetState.LOST
    viewer, _ = looked([None, tracked, tracked, coasting, lost, lost, TargetState.REACQUIRED, tracked])
    summary = viewer.summary()
    assert summary["frames"] == 8
    assert summary["tracked"] == 0.5
    some = {"tracked": 3, "coasting": 1, "reacquired": 1, "lost": 2, "unchosen": 1}
    assert summary["states"] == some | {"choosing": 0}
    assert 0 < summary["frame_ms"]["p50"] <= summary["frame_ms"]["p95"]
    assert summary["rate_hz"] > 0


def test_nothing_seen_can_be_summed_up():
    viewer, _ = looked([])
    assert viewer.summary()["frames"] == 0
    assert viewer.summary()["tracked"] is None


def test_a_policys_numbers_are_shown_in_the_axes_and_signs_of_its_manifest(monkeypatch):
    drawn = []
    monkeypatch.setattr(
        "adatracker_deploy.app.view_run.overlay", lambda *args: drawn.append(args[-1]) or picture(1)
    )
    for policy in (Backwards(), None):
        viewer, (seen,) = looked([TargetState.TRACKED], policy)
        viewer.drawn(seen)
        assert viewer.moves(seen) == (None if policy is None else {"yaw": -0.25, "forward": -0.5})
    assert drawn[0].moves == {"yaw": -0.25, "forward": -0.5}
    assert drawn[0].sees is None
    assert drawn[1] is None


# Films


def viewed(capsys, *arguments):
    """Run the command; return its JSON."""
    assert main(["view", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def frames_of(path):
    film, frames = Capture(str(path)), []
    while film.grab():
        frames.append(film.rgb())
    return frames, film.rate_hz


def test_every_frame_of_a_film_is_looked_at_and_left_drawn_over(capsys, tmp_path, pictures):
    out = tmp_path / "out.mp4"
    summary = viewed(capsys, pictures, "--write", out)
    assert (summary["frames"], summary["states"]["unchosen"]) == (12, 12)
    assert (summary["policy"], summary["written"]) == ("adatracker", str(out))
    assert "nanodet" in summary["segmenter"]
    frames, rate_hz = frames_of(out)
    assert rate_hz == 10.0
    middles = [round(float(frame[180, 240, 0]) / 10) for frame in frames]
    assert middles == list(range(1, 13))
    assert frames[0].shape == (360, 480, 3)


def test_twice_the_same_film_leaves_twice_the_same(capsys, tmp_path, pictures):
    films = []
    for name in ("one.mp4", "two.mp4"):
        viewed(capsys, pictures, "--write", tmp_path / name)
        films.append(frames_of(tmp_path / name)[0])
    assert len(films[0]) == 12
    assert all((one == two).all() for one, two in zip(*films, strict=True))


def test_without_a_policy_no_arrow_is_drawn(capsys, tmp_path, pictures):
    corners = {}
    for policy in ("adatracker", "pid", "none"):
        out = tmp_path / f"{policy}.mp4"
        summary = viewed(capsys, pictures, "--policy", policy, "--write", out)
        assert summary["policy"] == (None if policy == "none" else policy)
        frame = frames_of(out)[0][-1]
        corners[policy] = float(frame[-60:, :60].std()), float(frame[-60:, -60:].std())
    dial, inset = zip(*corners.values(), strict=True)
    assert min(dial[:2]) > 5 > dial[2]
    assert inset[0] > 5 > max(inset[1:])


def test_people_read_lines_and_see_where_to_watch(capsys, pictures):
    assert main(["view", f"{pictures}?rate=60", "--policy", "none"]) == 0
    lines = capsys.readouterr().out
    assert re.search(r"^watch it at http://127\.0\.0\.1:\d+/#\S{22} \(Ctrl-C ends\)$", lines, re.MULTILINE)
    assert re.search(r"^frames     12, [\d.]+ Hz$", lines, re.MULTILINE)
    assert re.search(r"^target     seen in 0\.0%: 12 unchosen$", lines, re.MULTILINE)
    assert re.search(r"^per frame  p50 [\d.]+ ms, p95 [\d.]+ ms$", lines, re.MULTILINE)


def test_a_film_that_is_watched_takes_its_own_time(capsys, pictures):
    summary = viewed(capsys, pictures, "--policy", "none")
    assert summary["frames"] == 12
    assert summary["rate_hz"] < 12  # 12 frames, 11 of which wait for a tenth of a second to pass


# Live cameras


class Rehearsal:
    """A camera that shows a person to its left, for as long as it is needed."""

    def __init__(self):
        self._server = MjpegServer()
        self.url = self._server.url
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._film, daemon=True)
        self._thread.start()

    def _film(self):
        mask = np.zeros((48, 64), np.uint8)
        mask[10:40, 5:20] = 1
        truth = Truth(mask, Pose(), Pose(), (0.0, 0.0), 2.0, 0.5)
        number = 0
        while not self._ending.wait(0.02):
            number += 1
            self._server.publish(Frame(picture(number % 20), time.monotonic_ns(), number, truth))

    def close(self):
        self._ending.set()
        self._thread.join()
        self._server.close()


@pytest.fixture
def rehearsal():
    camera = Rehearsal()
    yield camera
    camera.close()


@contextlib.contextmanager
def viewing(*arguments):
    """Run the command as a process of its own; gives it and the address that it printed."""
    command = [sys.executable, "-m", "adatracker_deploy", "view", *map(str, arguments)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8"
    ) as process:
        try:
            for line in process.stderr if "--json" in arguments else process.stdout:
                if line.startswith("watch it at "):
                    yield process, line.split()[3]
                    break
        finally:
            if process.poll() is None:
                process.kill()


def browser_of(url):
    """Return a browser at a page's printed address."""
    port, token = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/#(\S+)", url).groups()
    return Browser(SimpleNamespace(port=int(port), token=token))


def first_picture(url):
    """Return the page's first state with a picture: the state, the picture, the mask."""
    with browser_of(url).feed() as stream:
        news, *images = stream.until(lambda update: update[1])
    return news["state"], *(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) for data in images)


def test_a_live_camera_is_watched_in_a_browser_until_ctrl_c(rehearsal):
    with viewing(rehearsal.url, "--segmenter", "truth", "--json") as (process, url):
        state, bgr, mask = first_picture(url)
        assert bgr.shape == (48, 64, 3)
        assert (state["phase"], state["target"]) == ("viewing", "seen")
        assert state["box"] == pytest.approx([12.5 / 64, 25 / 48, 15 / 64, 30 / 48])
        assert state["wish"]["yaw_rate"] > 0  # the person is to the left
        assert state["ms"]["perception and policy"] > 0
        blue, green, _ = map(int, mask[mask.shape[0] // 2, round(mask.shape[1] * 12 / 64)])
        assert green > blue + 30  # the target's colour
        assert browser_of(url).post("/choose", seq=1, x=0.5, y=0.5)[0] == 409  # the truth cannot be chosen
        assert browser_of(url).post("/stop")[0] == 409
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=20)
    summary = json.loads(out.splitlines()[-1])
    assert process.returncode == 130
    assert err.splitlines()[-1] == "adatracker-deploy: interrupted"
    assert "Traceback" not in err
    assert summary["frames"] > 0
    assert summary["tracked"] == 1.0
    assert summary["states"]["tracked"] == summary["frames"]


def test_a_click_on_nobody_in_a_live_camera_is_told_on_the_page(rehearsal):
    with viewing(rehearsal.url, "--policy", "none", "--target", "click") as (process, url):
        browser = browser_of(url)
        with browser.feed() as stream:
            news, *_ = stream.until(lambda update: update[1])
            assert (news["state"]["target"], news["state"]["box"]) == ("no target yet", None)
            assert browser.post("/choose", seq=news["state"]["seq"], x=0.25, y=0.5) == (202, {"number": 1})
            news, *_ = stream.until(lambda update: "events" in update[0])
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=20)
    ((level, text),) = news["events"]
    assert level == "warning"
    assert text == "click at 0.25, 0.50: nobody was found there, so the target is the same as before"


def test_the_page_tells_that_a_policy_searches():
    segmenter = Scripted([TargetState.LOST] * 2)
    frame = Frame(rgb=picture(1), t_ns=0, seq=0)
    address = Address(unused_port(socket.SOCK_STREAM))
    page = ViewPage(address, "film", "backwards", "auto", segmenter)
    with contextlib.closing(page), browser_of(page.url).feed() as stream:
        for searches in (True, False):
            action = Action(np.zeros(2, np.float32), searching=searches)
            page.show(Viewed(frame, segmenter(frame), action, 1.0), None, None)
            news, *_ = stream.until(lambda update: update[0].get("state"))
            assert news["state"]["searching"] is searches


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_what_was_written_of_a_live_camera_can_be_seen_after_an_interruption(rehearsal, tmp_path, end):
    out = tmp_path / "live.mp4"
    with viewing(rehearsal.url, "--segmenter", "truth", "--write", out) as (process, url):
        for _ in range(3):
            first_picture(url)
        process.send_signal(end)
        process.communicate(timeout=20)
    assert process.returncode == 130
    frames, rate_hz = frames_of(out)
    assert (len(frames) > 0, rate_hz) == (True, 20.0)


def test_a_camera_that_goes_is_said_to_be_gone_after_what_was_seen_of_it(rehearsal, capsys):
    threading.Timer(2.0, rehearsal.close).start()
    assert main(["view", rehearsal.url, "--segmenter", "truth", "--json"]) == 1
    out, err = capsys.readouterr()
    assert json.loads(out.splitlines()[-1])["frames"] > 0
    assert "the stream has ended" in err.splitlines()[-1]


@EXHAUSTIVE
def test_a_camera_that_never_opens_is_told_in_five_seconds(capsys):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        url = f"http://127.0.0.1:{listener.getsockname()[1]}/"
        assert main(["view", url, "--policy", "none"]) == 1
    assert "no picture came within 5 s" in capsys.readouterr().err


# Wrong requests


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "FILE|CAMERA"),
        (("no-such-file.mp4",), "no such file"),
        (("{text}",), "cannot be opened as a video"),
        (("world://simple_room",), "only in a run with its robot"),
        (("{pictures}", "--segmenter", "genius"), "segmenter 'genius': expected embedded"),
        (("{pictures}", "--segmenter", "no.onnx"), "no.onnx"),
        (("{pictures}", "--prompt", "cat"), "prompt 'cat'"),
        (("{pictures}", "--target", "tallest"), "tallest"),
        (("{pictures}", "--policy", "genius"), "unknown policy 'genius'"),
        (("{pictures}", "--write", "out.gif"), "--write out.gif: expected a file name that ends in .mp4"),
        (("{pictures}", "--write", "no/such/out.mp4"), "there is no folder no/such"),
        (("{pictures}", "--write", "out.mp4", "--port", "8080"), "drop --port"),
        (("{pictures}", "--write", "out.mp4", "--target", "click"), "drop --target click"),
        (("{film}", "--write", "{film}"), "this is the input film"),
        (("{pictures}", "--port", "70000"), "70000 is not a port"),
        (("{pictures}", "--port", "{taken}"), "in use"),
    ],
)
def test_a_wrong_request_is_refused_in_one_line(capsys, tmp_path, pictures, arguments, words):
    text, film = tmp_path / "text.mp4", tmp_path / "film.mp4"
    text.write_text("no film", encoding="ascii")
    film.write_bytes(b"any")
    with socket.create_server(("127.0.0.1", 0)) as listener:
        places = {
            "text": text,
            "film": film,
            "pictures": pictures,
            "taken": listener.getsockname()[1],
        }
        status = main(["view", *(argument.format(**places) for argument in arguments)])
    out, err = capsys.readouterr()
    (line,) = err.strip().splitlines()
    assert (status, out) == (2, "")
    assert words in line
    assert film.read_bytes() == b"any"
