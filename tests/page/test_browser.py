"""The page in a real browser: it shows the run, takes clicks and the stop, and keeps its own rules."""

from __future__ import annotations

import contextlib
import itertools
import json
import re
import shutil
import subprocess
import threading
import time

import cv2
import numpy as np
import pytest

from adatracker_deploy.core.mask_png import PALETTE, encode_mask
from adatracker_deploy.core.messages import Box, MaskClass
from adatracker_deploy.page.address import Address, free_port
from adatracker_deploy.page.feed import Feed, Pictures
from adatracker_deploy.page.server import PageServer
from adatracker_deploy.trial.page_view import of_step
from tests.trial.records import a_step

websockets = pytest.importorskip("websockets.sync.client", reason="needs the extra 'live'")

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [pytest.mark.slow, pytest.mark.skipif(BROWSER is None, reason="there is no Chromium here")]
WAIT_S = 60.0
ABOUT = {
    "title": "wheeled, <b>rehearsal</b>",
    "what": "adatracker",
    "unit": "si",
    "full": {"vx": 2.0, "yaw_rate": 1.0},
    "steps": 600,
    "stop": True,
}
GREY = 96
SAID = ("Log.entryAdded", "Runtime.exceptionThrown", "Runtime.consoleAPICalled")


class Tab:
    """One page in Chromium, driven by its DevTools protocol."""

    def __init__(self, url, folder) -> None:
        self.command = (
            BROWSER,
            *("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-background-networking"),
            *("--disable-component-update", "--disable-sync", "--no-first-run", "--remote-debugging-port=0"),
            *(
                "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
                "--window-size=1280,860",
                "--hide-scrollbars",
            ),
            *(f"--user-data-dir={folder / 'profile'}", "about:blank"),
        )
        self.process = subprocess.Popen(self.command, stderr=subprocess.PIPE, text=True)
        for line in self.process.stderr:
            if found := re.search(r"DevTools listening on (ws://\S+)", line):
                break
        else:
            pytest.fail("Chromium did not start")
        self.drain = threading.Thread(target=self.process.stderr.read, daemon=True)
        self.drain.start()
        self.numbers, self.said = itertools.count(1), []
        self.stack = contextlib.ExitStack()
        self.socket = self.stack.enter_context(
            websockets.connect(found[1], max_size=None, open_timeout=WAIT_S)
        )
        self.session = None
        (target,) = [t for t in self.ask("Target.getTargets")["targetInfos"] if t["type"] == "page"]
        attached = self.ask("Target.attachToTarget", targetId=target["targetId"], flatten=True)
        self.session = attached["sessionId"]
        for domain in ("Runtime", "Log", "Page"):
            self.ask(f"{domain}.enable")
        self.ask("Page.navigate", url=url)

    def ask(self, method, **params):
        """Ask the browser for something; return its answer, and keep what the page has said meanwhile."""
        number = next(self.numbers)
        session = {} if self.session is None else {"sessionId": self.session}
        self.socket.send(json.dumps({"id": number, "method": method, "params": params} | session))
        while (told := json.loads(self.socket.recv(timeout=WAIT_S))).get("id") != number:
            if told.get("method") in SAID:
                self.said.append(told["params"])
        assert "error" not in told, told
        return told["result"]

    def value(self, expression):
        answer = self.ask("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def until(self, expression, wanted=True):
        """Wait until an expression has a value; while the page loads it has none."""
        deadline_s = time.monotonic() + WAIT_S
        what = f"(() => {{ try {{ return {expression}; }} catch {{ return null; }} }})()"
        while (found := self.value(what)) != wanted:
            assert time.monotonic() < deadline_s, f"{expression}: {found!r}, not {wanted!r}"

    def text(self, name):
        return self.value(f"document.getElementById('{name}').innerText")

    def click(self, expression, x=0.5, y=0.5):
        """Press the mouse on an element, at a point in fractions of it."""
        place = json.loads(self.value(f"JSON.stringify({expression}.getBoundingClientRect())"))
        where = {"x": place["x"] + x * place["width"], "y": place["y"] + y * place["height"]}
        for kind in ("mousePressed", "mouseReleased"):
            self.ask("Input.dispatchMouseEvent", type=kind, button="left", clickCount=1, **where)

    def close(self):
        self.stack.close()
        self.process.terminate()
        self.process.wait(WAIT_S)
        self.drain.join()
        self.process.stderr.close()


@contextlib.contextmanager
def shown(folder, **settings):
    """A page that is fed, its server, and a tab in which it is open."""
    address, feed = Address(free_port(0, "the page", "--page")), Feed(ABOUT)
    server = PageServer(address, feed, option="--page", **settings)
    ending = threading.Event()
    feeder = threading.Thread(target=_feed, args=(feed, ending))
    feeder.start()
    try:
        with contextlib.closing(Tab(address.url, folder)) as tab:
            yield tab, feed, server
    finally:
        ending.set()
        feeder.join()
        server.close()


def _feed(feed, ending):
    """Show a grey picture with somebody in its left half, until the end."""
    jpeg = bytes(cv2.imencode(".jpg", np.full((480, 640, 3), GREY, np.uint8))[1])
    mask = np.zeros((60, 80), np.uint8)
    mask[10:50, 10:30] = MaskClass.TARGET
    pictures = Pictures(jpeg, encode_mask(mask))
    for number in itertools.count(1):
        box = Box(0.25, 0.5, 0.25, 2 / 3)
        feed.show(of_step(a_step(number, box=box, target="tracked", driver="policy")), pictures)
        if ending.wait(0.05):
            return


def test_it_shows_picture_mask_box_velocities_gate_and_times(tmp_path):
    with shown(tmp_path) as (tab, feed, _):
        tab.until("frame !== null && state !== null")
        tab.until("mask !== null && state !== null")
        pixel = "Array.from(pen.getImageData({}, {}, 1, 1).data).slice(0, 3)"
        places = (500, 60), (160, 240), (80, 240)
        background, inside, edge = (tab.value(pixel.format(x, y)) for x, y in places)
        tinted = [0.58 * GREY + 0.42 * part for part in PALETTE[MaskClass.TARGET]]
        assert background == pytest.approx([GREY] * 3, abs=3)
        assert inside == pytest.approx(tinted, abs=6)
        assert edge[1] > 180 > 2 * edge[0]  # the box's line
        assert tab.text("chip") == "tracked 0.90"
        said = tab.value(
            "state = {...state, target: 'lost', searching: true}, show(), byId('chip').textContent"
        )
        assert said == "lost, searching 0.90"
        assert tab.text("title") == "wheeled, <b>rehearsal</b>"  # text stays text
        assert re.fullmatch(r"following · step \d+ of 600", tab.text("clock"))
        axes = " ".join(tab.text("axes").split())
        assert axes == "forward 1.00 m/s 0.80 m/s turn left -0.50 rad/s -0.50 rad/s"
        assert tab.text("gate") == "acceleration"
        assert "infer\t2.0 ms" in tab.text("latency")
        assert tab.text("notice") == ""
        feed.say("error", "<script>document.title='owned'</script>")
        tab.until("byId('events').innerText", "<script>document.title='owned'</script>")
        assert tab.text("title") == "wheeled, <b>rehearsal</b>"
        # No error, and nothing that its own policy forbids; only this test's reading of the canvas is noted.
        assert [said for said in tab.said if said.get("entry", {}).get("source") != "rendering"] == []
        assert tab.ask("Page.captureScreenshot")["data"]


def test_a_click_names_its_point_and_frame_and_the_answer_is_shown(tmp_path):
    with shown(tmp_path) as (tab, feed, server):
        tab.until("frame !== null && state !== null")
        tab.click("canvas", 0.25, 0.75)
        while not (clicks := server.clicks()):
            tab.value("1")  # lets the page go on
        ((number, seq, x, y),) = clicks
        assert (number, x, y) == (1, pytest.approx(0.25, abs=0.01), pytest.approx(0.75, abs=0.01))
        assert 0 < seq <= tab.value("state.seq")
        feed.say("warning", "click at 0.25, 0.75: nobody was found there")
        tab.until("byId('notice').innerText", "click at 0.25, 0.75: nobody was found there")


def test_stop_asks_for_the_stop_and_says_what_became_of_it(tmp_path):
    stopped = threading.Event()
    with shown(tmp_path, stop=lambda: stopped.set() or "the run stops") as (tab, _, server):
        tab.until("byId('stop').hidden", False)
        tab.click("byId('stop')")
        tab.until("byId('notice').innerText", "the run stops")
        assert stopped.is_set()
        server.close()
        tab.until("byId('notice').innerText.startsWith('Not connected')")


def test_without_the_token_it_says_what_to_do(tmp_path):
    with shown(tmp_path) as (tab, _, server):
        tab.ask("Page.navigate", url=f"http://127.0.0.1:{server._server.server_port}/?")
        tab.ask("Page.navigate", url=f"http://127.0.0.1:{server._server.server_port}/")
        tab.until("byId('notice').innerText.startsWith('Open the address that the command printed')")
