"""A browser's side of the page, as far as its wire goes; it shares no code with the server."""

from __future__ import annotations

import http.client
import json
import struct

WAIT_S = 20.0


class Browser:
    """Talks to one page."""

    def __init__(self, address) -> None:
        self.port, self.token = address.port, address.token

    def ask(self, method, path, body=None, *, token=True, **headers):
        """Return the response's status and what it says."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=WAIT_S)
        if token:
            headers["Authorization"] = f"Bearer {self.token if token is True else token}"
        try:
            connection.request(method, path, body, headers)
            response = connection.getresponse()
            return response.status, response.headers, response.read()
        finally:
            connection.close()

    def post(self, path, **body):
        status, _, said = self.ask("POST", path, json.dumps(body))
        return status, json.loads(said)

    def feed(self) -> Feed:
        return Feed(self)


class Feed:
    """The stream of updates: (news, jpeg, mask)."""

    def __init__(self, browser) -> None:
        self.connection = http.client.HTTPConnection("127.0.0.1", browser.port, timeout=WAIT_S)
        self.connection.request("GET", "/feed", headers={"Authorization": f"Bearer {browser.token}"})
        self.response = self.connection.getresponse()
        assert self.response.status == 200

    def next(self):
        """Return the next update.

        Raises:
            EOFError: the stream has ended.
        """
        header = self.response.read(12)
        if len(header) < 12:
            raise EOFError
        text, jpeg, mask = (self.response.read(length) for length in struct.unpack("<III", header))
        return json.loads(text), jpeg, mask

    def until(self, condition):
        """Return the first update that meets a condition."""
        while not condition(update := self.next()):
            pass
        return update

    def close(self):
        self.connection.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
