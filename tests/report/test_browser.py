"""The page in a real browser: it is shown without an error and asks nobody for anything."""

from __future__ import annotations

import json
import re
import shutil
import subprocess

import pytest

from adatracker_deploy.report.gather import gather, moments
from adatracker_deploy.report.set_page import set_page
from adatracker_deploy.report.trial_page import trial_page
from tests.report.pages import a_hostile_trial, a_varied_trial

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [pytest.mark.slow, pytest.mark.skipif(BROWSER is None, reason="there is no Chromium here")]

_OWN = "not an origin"
"""The initiator of what the browser asks for by itself."""


def visit(page, folder):
    """Open a page; return what its console said, what it asked for, and its document afterwards."""
    net_log, errors = folder / "net.json", folder / "stderr"
    command = (
        BROWSER,
        *("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-background-networking"),
        *("--disable-component-update", "--disable-sync", "--no-first-run", "--enable-logging=stderr"),
        # The browser's own errands end here as well: no name has an address, and the proxy is dead.
        *("--host-resolver-rules=MAP * ~NOTFOUND", "--proxy-server=127.0.0.1:9"),
        *("--proxy-bypass-list=<-loopback>", f"--user-data-dir={folder / 'profile'}"),
        *(f"--log-net-log={net_log}", "--virtual-time-budget=2000", "--dump-dom", page.as_uri()),
    )
    with errors.open("w") as stderr:
        done = subprocess.run(
            command, check=True, stdout=subprocess.PIPE, stderr=stderr, text=True, timeout=120
        )
    console = re.findall(r"CONSOLE:\d+\] (.*)", errors.read_text())
    log = json.loads(net_log.read_text())
    started = log["constants"]["logEventTypes"]["URL_REQUEST_START_JOB"]
    begun = [event["params"] for event in log["events"] if event["type"] == started and "params" in event]
    requests = [request["url"] for request in begun if request.get("initiator", _OWN) != _OWN]
    return console, requests, done.stdout


def test_pages_of_hostile_trials_are_shown_without_a_word_or_a_request(tmp_path):
    varied, hostile = (
        gather(a_varied_trial(tmp_path / "varied")),
        gather(a_hostile_trial(tmp_path / "hostile")),
    )
    (tmp_path / "one.html").write_text(trial_page(hostile, moments(hostile.trial)))
    (tmp_path / "set.html").write_text(set_page([varied, hostile]))
    both = tmp_path / "both.html"
    frames = [
        f"<iframe src={name}.html onload=\"document.title += '{name} '\"></iframe>" for name in ("one", "set")
    ]
    both.write_text("".join(frames))
    console, requests, document = visit(both, tmp_path)
    assert (console, requests) == ([], [])
    title = document.partition("</title>")[0]
    assert "one" in title, "the page of a trial was not shown"
    assert "set" in title, "the page of a set was not shown"


def test_a_page_that_asks_or_complains_would_be_noticed(tmp_path):
    page = tmp_path / "page.html"
    page.write_text("<script>console.error('no')</script><img src=http://127.0.0.1:9/x.png>")
    console, requests, _ = visit(page, tmp_path)
    assert len(console) == 1
    assert requests == ["http://127.0.0.1:9/x.png"]
