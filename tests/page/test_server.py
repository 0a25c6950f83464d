"""The operator's page over a real socket: what it shows, what it takes, and whom it refuses."""

from __future__ import annotations

import contextlib
import math
import re
import socket
import threading

import pytest

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Click
from adatracker_deploy.page import server as server_module
from adatracker_deploy.page.address import Address, free_port
from adatracker_deploy.page.feed import KEPT_EVENTS, Feed, Pictures
from adatracker_deploy.page.loopback import MAX_CONNECTIONS
from adatracker_deploy.page.server import PageServer, page
from tests.page.browsing import Browser

ABOUT = {"title": "wheeled", "stop": True}


@contextlib.contextmanager
def serving(**settings):
    """A page, its feed, and a browser that knows its address."""
    address, feed = Address(free_port(0, "the page", "--page")), Feed(ABOUT)
    server = PageServer(address, feed, option="--page", **settings)
    try:
        yield server, feed, Browser(address)
    finally:
        server.close()


def test_the_page_is_one_small_file_that_loads_nothing_else():
    html, policy = page()
    text = html.decode()
    assert len(text.splitlines()) < 300
    assert not re.findall(r"(?:src|href)=\"(?!data:)|https?://|@import|url\(", text)
    assert not re.findall(r"innerHTML|outerHTML|document\.write|eval\(| on\w+=", text)  # text stays text
    assert "'unsafe" not in policy
    assert "frame-ancestors 'none'" in policy
    with serving() as (_, _, browser):
        status, headers, body = browser.ask("GET", "/", token=False)
    assert (status, body) == (200, html)
    assert headers["Content-Security-Policy"] == policy
    assert headers["X-Frame-Options"] == "DENY"
    assert "Access-Control-Allow-Origin" not in headers


def test_a_browser_is_shown_the_run_then_the_newest_state_with_its_picture_and_what_happened():
    with serving() as (_, feed, browser):
        feed.say("warning", "the wind freshens")
        feed.show({"seq": 1})
        with browser.feed() as stream:
            assert stream.next() == ({"about": ABOUT}, b"", b"")
            news, *_ = stream.until(lambda update: "state" in update[0])
            assert news == {"state": {"seq": 1}, "events": [["warning", "the wind freshens"]]}
            assert feed.watched
            feed.show({"seq": 2, "battery": math.nan, "box": (0.5, 0.5)}, Pictures(b"jpeg", b"png"))
            news, *pictures = stream.until(lambda update: "state" in update[0])
            assert news == {"state": {"seq": 2, "battery": None, "box": [0.5, 0.5]}}
            assert pictures == [b"jpeg", b"png"]
            feed.show({"seq": 3})  # of the same picture
            assert stream.until(lambda update: "state" in update[0])[1:] == (b"", b"")


def test_a_still_run_is_told_from_a_dead_server_by_an_empty_update(monkeypatch):
    monkeypatch.setattr("adatracker_deploy.page.feed.HEARTBEAT_S", 0.01)
    with serving() as (_, _, browser), browser.feed() as stream:
        assert [stream.next()[0] for _ in range(4)] == [{"about": ABOUT}, {}, {}, {}]


def test_a_browser_that_reads_slowly_skips_pictures_and_holds_up_nobody():
    with serving() as (_, feed, browser), browser.feed() as stream:
        stream.next()
        large = bytes(1 << 20)
        for number in range(60):
            feed.show({"seq": number}, Pictures(large, b""))  # 60 MB that no buffer here holds
        feed.say("info", "the last")
        seen = []
        while not seen or seen[-1] != 59:
            news, *_ = stream.until(lambda update: "state" in update[0])
            seen.append(news["state"]["seq"])
        assert len(seen) < 60


def test_what_happened_is_kept_for_late_browsers_up_to_a_number():
    with serving() as (_, feed, browser):
        for number in range(KEPT_EVENTS + 5):
            feed.say("info", str(number))
        with browser.feed() as stream:
            news, *_ = stream.until(lambda update: "events" in update[0])
    assert [text for _, text in news["events"]] == [str(n) for n in range(5, KEPT_EVENTS + 5)]


def test_a_click_is_taken_once_with_its_number_and_the_frame_that_was_clicked():
    with serving() as (server, _, browser):
        assert browser.post("/choose", seq=7, x=0.25, y=1) == (202, {"number": 1})
        assert browser.post("/choose", seq=8, x=0, y=0.5) == (202, {"number": 2})
        assert server.clicks() == [Click(1, 7, 0.25, 1.0), Click(2, 8, 0.0, 0.5)]
        assert server.clicks() == []


@pytest.mark.parametrize(
    "body",
    [
        *("", "{", "[]", "1", "{}", '{"seq": 1, "x": 0.5}', '{"seq": 1, "x": 1.5, "y": 0}', "[" * 900),
        *('{"seq": 1, "x": NaN, "y": 0}', '{"seq": -1, "x": 0, "y": 0}', '{"seq": 1, "x": true, "y": 0}'),
        *('{"seq": 1.5, "x": 0, "y": 0}', '{"seq": 1, "x": "0", "y": 0}', " " * 2000),
    ],
)
def test_what_is_no_click_is_refused_with_the_reason(body):
    with serving() as (server, _, browser):
        status, _, said = browser.ask("POST", "/choose", body)
        assert (status, server.clicks()) == (400, [])
        assert b"expected" in said


def test_where_nobody_can_be_chosen_a_click_says_why():
    with serving(unchoosable="it knows the target") as (server, _, browser):
        assert browser.post("/choose", seq=1, x=0.5, y=0.5) == (409, {"why": "it knows the target"})
        assert server.clicks() == []


def test_a_stop_is_made_and_what_became_of_it_is_said():
    stopped = []
    with serving(stop=lambda: stopped.append(1) or "the run stops") as (_, _, browser):
        assert browser.post("/stop") == (200, {"said": "the run stops"})
        assert stopped == [1]
    with serving() as (_, _, browser):
        assert browser.post("/stop")[0] == 409


@pytest.mark.parametrize(("method", "path"), [("GET", "/feed"), ("POST", "/stop"), ("POST", "/choose")])
@pytest.mark.parametrize(
    ("status", "how"),
    [
        (401, {"token": False}),
        (401, {"token": "another"}),
        (403, {"Origin": "http://evil.test"}),
        (403, {"Origin": "null"}),
        (403, {"Host": "evil.test"}),
    ],
)
def test_without_the_token_or_from_elsewhere_nothing_is_shown_and_nothing_done(method, path, status, how):
    stopped = []
    with serving(stop=lambda: stopped.append(1) or "") as (server, _, browser):
        got, headers, said = browser.ask(method, path, '{"seq": 1, "x": 0.5, "y": 0.5}', **how)
        assert (got, stopped, server.clicks()) == (status, [], [])
        assert b"why" in said
        assert "Access-Control-Allow-Origin" not in headers


def test_a_page_elsewhere_may_not_ask_for_leave_to_send_a_token():
    with serving() as (_, _, browser):
        asked = {"Origin": "http://evil.test", "Access-Control-Request-Headers": "authorization"}
        status, headers, _ = browser.ask("OPTIONS", "/stop", token=False, **asked)
    assert status == 501
    assert "Access-Control-Allow-Origin" not in headers


def test_a_port_in_use_is_refused_in_a_sentence():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        taken = listener.getsockname()[1]
        for ask in (
            lambda: free_port(taken, "the page", "--page"),
            lambda: PageServer(Address(taken), Feed({}), option="--page"),
        ):
            with pytest.raises(UsageError, match=rf"TCP port {taken} for the page: .* with --page PORT"):
                ask()


def test_connections_are_bounded_and_those_that_say_nothing_are_let_go(monkeypatch):
    monkeypatch.setattr(server_module._Handler, "timeout", 0.3)
    with serving() as (_, _, browser), contextlib.ExitStack() as stack:
        idle = [
            stack.enter_context(socket.create_connection(("127.0.0.1", browser.port), timeout=10))
            for _ in range(MAX_CONNECTIONS + 1)
        ]
        assert all(one.recv(1) == b"" for one in idle)
        assert browser.ask("GET", "/", token=False)[0] == 200


def test_its_end_ends_every_stream_and_frees_the_port():
    with serving() as (server, _, browser), browser.feed() as stream:
        stream.next()
        server.close()
        with pytest.raises(EOFError):
            stream.until(lambda update: False)
        assert free_port(browser.port, "the page", "--page") == browser.port
        assert not any(thread.name == "page" for thread in threading.enumerate())
