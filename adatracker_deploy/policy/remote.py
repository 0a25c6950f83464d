"""A policy on another machine, by openpi's protocol: MessagePack over a WebSocket (docs/remote.md).

One thread speaks with the server: one question at a time, the newest observation. A tick waits for its own
answer for half a period; if that does not come, it acts on the newest answer there is, which says when its
picture was taken. How old that may be is judged by the loop and the gate, as for policies in this process.
So a server that is slow, or drops answers, makes the robot stand still; one that is gone or wrong ends the
trial.
"""

from __future__ import annotations

import contextlib
import logging
import socket
import ssl
import threading
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.messages import Action, Answer, Observation, PlatformState
from adatracker_deploy.policy.base import STALE_OBSERVATION_S, NoAnswer, PolicyInfo
from adatracker_deploy.policy.contract import Contract, Reply, read_contract, read_reply, request
from adatracker_deploy.policy.msgpack_numpy import LARGEST_BYTES, pack, unpack

if TYPE_CHECKING:
    from websockets.sync.client import ClientConnection

CONNECT_S = 5.0
"""Time-out of the connection, and then of the metadata: a server loads a bundle in a second."""
FIRST_S = 60.0
"""Time-out of the first answer: a large model may compile at its first question."""
TRIES = 5
"""Timed questions before the start; the quickest answer counts."""
PATIENCE = 0.5
"""Part of a period for which a tick waits for its own answer."""
HEARD_S = 0.05
"""Polling interval of the thread, s."""
FORGOTTEN_S = 10.0
"""Age of a question after which its answer is no longer accepted."""
BLANK = Observation(
    mask=np.zeros((480, 640), np.uint8),
    box=None,
    confidence=0.0,
    t_ns=0,
    seq=0,
    image=np.zeros((480, 640, 3), np.uint8),
    state=PlatformState(0),
)
"""The observation of the test questions before anything moves."""


class _Question(NamedTuple):
    number: int
    observation: Observation
    asked_s: float
    """Time of the loop's question by `time.monotonic`, like the next."""
    seed: int | None
    """Seed of the episode that begins with it; None within one."""
    sent_s: float = 0.0


class _Answered(NamedTuple):
    number: int
    t_ns: int
    """Capture time of the picture that it answers, ns of the run's clock."""
    reply: Reply
    queue_ms: float
    round_trip_ms: float


@dataclass(slots=True)
class _Shared:
    """The state shared by the loop and the thread, under one condition."""

    changed: threading.Condition = field(default_factory=threading.Condition)
    asked: _Question | None = None
    """The newest question, until it is sent."""
    answered: _Answered | None = None
    """The answer to the newest question that has one."""
    first: int = 1
    """The first question of this episode; answers to earlier ones are ignored."""
    error: str = ""
    closed: bool = False


class RemotePolicy:
    """Implements `Policy`.

    Args:
        uri: ``ws://HOST:PORT`` or ``wss://HOST:PORT``.
        token: sent as ``Authorization: Api-Key TOKEN``.
        prompt: the instruction, for a server that wants one.
        patience_s: how long `act` waits for its own answer, which then must come: for evaluations, where time
            stands still meanwhile. None for a robot's loop: half a period.
    """

    def __init__(
        self, uri: str, *, token: str = "", prompt: str = "", patience_s: float | None = None
    ) -> None:
        """Connect, and ask with blank pictures.

        Raises:
            UsageError: nobody answers, or not as a policy does, or too late for any robot.
        """
        self._uri, self._prompt = _shown(uri), prompt
        self._server, self._contract = _connected(uri, token)
        self._info = self._contract.info(self._uri)
        try:
            self._repeats = self._tried(in_time=patience_s is None)
        except BaseException:
            _cut(self._server)
            raise
        self._offline = patience_s is not None
        self._patience_s = patience_s or PATIENCE / self._contract.rate_hz
        self._shared, self._number, self._seed = _Shared(), 0, 0
        self._begins = True
        self._thread = threading.Thread(target=self._converse, name="remote policy", daemon=True)
        self._thread.start()

    @property
    def info(self) -> PolicyInfo:
        """The policy's description, from its server's contract."""
        return self._info

    def check(self) -> None:
        """Check that its server is still there; before a trial.

        Raises:
            PlatformError: it is not.
        """
        if self._server.close_code is not None:
            self._fail("the server is gone")
        with self._shared.changed:
            self._refuse_failed()

    def reset(self, seed: int = 0) -> None:
        """Forget every answer; the next observation tells the server that an episode begins."""
        with self._shared.changed:
            self._seed, self._begins = seed, True
            self._shared.first = self._number + 1
            self._shared.asked = self._shared.answered = None

    def act(self, observation: Observation) -> Action:
        """Return the answer to this observation, or what the newest answer has for its time.

        Raises:
            NoAnswer: there is none in this episode so far.
            PlatformError: the server is gone, or has answered an invalid action.
            UsageError: the server wants the camera's picture, and there is none (in `evaluate`, `replay`).
        """
        if "image" in self._contract.observation and observation.image is None:
            raise UsageError(f"policy {self._uri} needs the camera's picture, which is not available here")
        shared = self._shared
        with shared.changed:
            self._refuse_failed()
            self._number += 1
            number = self._number
            seed = self._seed if self._begins else None
            if shared.asked is not None and seed is None:
                seed = shared.asked.seed  # the question that it replaces would have said so
            shared.asked, self._begins = _Question(number, observation, time.monotonic(), seed), False
            shared.changed.notify_all()
            shared.changed.wait_for(
                lambda: shared.error or (shared.answered is not None and shared.answered.number >= number),
                self._patience_s,
            )
            self._refuse_failed()
            answered = shared.answered
        if self._offline and (answered is None or answered.number < number):
            raise PlatformError(f"policy {self._uri}: no answer within {self._patience_s:g} s")
        if answered is None:
            raise NoAnswer
        rows = answered.reply.actions
        row = round((observation.t_ns - answered.t_ns) / 1e9 * self._contract.rate_hz)
        way = Answer(answered.t_ns, answered.queue_ms, answered.round_trip_ms, answered.reply.server_ms)
        values = rows[min(max(0, row), len(rows) - 1)]
        return Action(values, answered.reply.context, way, answered.reply.searching)

    def close(self) -> None:
        """End the conversation, at once; may be called twice."""
        with self._shared.changed:
            self._shared.closed = True
            self._shared.changed.notify_all()
        _cut(self._server)
        self._thread.join()

    def _refuse_failed(self) -> None:
        if self._shared.error:
            raise PlatformError(f"policy {self._uri}: {self._shared.error}")

    def _fail(self, why: str) -> None:
        with self._shared.changed:
            self._shared.error = self._shared.error or why
            self._shared.changed.notify_all()

    def _tried(self, *, in_time: bool) -> bool:
        """Ask with blank pictures; return whether the server repeats the numbers of requests."""
        quickest_s = FIRST_S
        for number in range(-TRIES, 0):  # the loop's own are counted from 1
            began_s = time.monotonic()
            try:
                said = request(self._contract, BLANK, number=number, seed=0, prompt=self._prompt)
                self._server.send(pack(said))
                reply = _read(self._server.recv(timeout=FIRST_S), self._contract)
            except TimeoutError:
                raise UsageError(f"policy {self._uri}: no answer within {FIRST_S:g} s") from None
            except Exception as error:  # the library's errors have no common base
                raise UsageError(f"policy {self._uri}: {_sentence(error)}") from error
            if not np.isfinite(reply.actions).all():
                raise UsageError(f"policy {self._uri}: its answer to a blank picture is not finite")
            quickest_s = min(quickest_s, time.monotonic() - began_s)
        if in_time and quickest_s > STALE_OBSERVATION_S:
            raise UsageError(
                f"policy {self._uri}: answers after {quickest_s:.2f} s; pictures older than "
                f"{STALE_OBSERVATION_S:g} s are not acted on, and the robot would stand still"
            )
        return reply.request is not None

    def _converse(self) -> None:
        """Ask the newest question, hear its answer, and so on until closed."""
        shared = self._shared
        waiting: dict[int, _Question] = {}
        try:
            while not shared.closed:
                if question := self._due(waiting):
                    self._ask(question, waiting)
                if waiting:
                    self._hear(waiting)
        except Exception as error:  # the library's errors have no common base; the loop is told
            self._fail(_sentence(error))

    def _due(self, waiting: dict[int, _Question]) -> _Question | None:
        """Return the question to ask now, if any; wait for one where there is nothing else to do.

        An answer that comes too late to be acted on is not waited for, if it will say what it answers.
        """
        if waiting:
            newest_s = max(question.sent_s for question in waiting.values())
            if not self._repeats or time.monotonic() - newest_s < STALE_OBSERVATION_S:
                return None
        shared = self._shared
        with shared.changed:
            if not waiting:
                shared.changed.wait_for(lambda: shared.asked is not None or shared.closed)
            question, shared.asked = shared.asked, None
        return question

    def _ask(self, question: _Question, waiting: dict[int, _Question]) -> None:
        said = request(
            self._contract,
            question.observation,
            number=question.number,
            seed=question.seed,
            prompt=self._prompt,
        )
        sent_s = time.monotonic()
        self._server.send(pack(said))
        waiting[question.number] = question._replace(sent_s=sent_s)

    def _hear(self, waiting: dict[int, _Question]) -> None:
        try:
            reply = _read(self._server.recv(timeout=HEARD_S), self._contract)
        except TimeoutError:
            return
        now_s = time.monotonic()
        number = next(iter(waiting)) if reply.request is None else reply.request
        question = waiting.pop(number, None)
        if question is None or (reply.request is None) is self._repeats:
            raise ValueError(f"it answers request {reply.request}, which was not made, or is long past")
        for past in [known for known, each in waiting.items() if now_s - each.sent_s > FORGOTTEN_S]:
            del waiting[past]
        answered = _Answered(
            number,
            question.observation.t_ns,
            reply,
            queue_ms=(question.sent_s - question.asked_s) * 1e3,
            round_trip_ms=(now_s - question.sent_s) * 1e3,
        )
        shared = self._shared
        with shared.changed:
            newest = shared.first if shared.answered is None else shared.answered.number + 1
            if number >= newest:  # not of an earlier episode, and not overtaken
                shared.answered = answered
            shared.changed.notify_all()


def _connected(uri: str, token: str) -> tuple[ClientConnection, Contract]:
    try:
        from websockets.sync.client import connect
    except ImportError as error:
        raise UsageError(
            "a policy on another machine needs websockets: pip install 'adatracker-deploy[remote]'"
        ) from error
    quiet = logging.getLogger(f"{__name__}.websockets")
    quiet.disabled = True  # what fails is raised
    try:
        opened = connect(
            uri,
            additional_headers={"Authorization": f"Api-Key {token}"} if token else None,
            compression=None,
            max_size=LARGEST_BYTES,
            open_timeout=CONNECT_S,
            close_timeout=1.0,
            logger=quiet,
            ssl=_tls() if uri.startswith("wss://") else None,
        )
        server = contextlib.ExitStack().enter_context(opened)  # left by `_cut`
    except Exception as error:  # as they come: refused, no WebSocket, no such host, a wrong certificate
        raise UsageError(f"policy {_shown(uri)}: cannot be reached: {_sentence(error)}") from error
    try:
        return server, read_contract(_unpacked(server.recv(timeout=CONNECT_S)))
    except TimeoutError:
        why = f"it accepts the connection, but sends no metadata for {CONNECT_S:g} s"
    except Exception as error:  # closed at once, no message, no contract
        why = _sentence(error)
    _cut(server)
    raise UsageError(f"policy {_shown(uri)}: {why}")


def _tls() -> ssl.SSLContext:
    """Return a context of TLS 1.2.

    By TLS 1.3, a server's session tickets come after the handshake. The reading thread of websockets 17.4
    then waits for what follows them and cannot be ended: an opening that times out never returns, and one of
    600 loses its request.
    """
    context = ssl.create_default_context()
    context.maximum_version = ssl.TLSVersion.TLSv1_2
    return context


def _read(answer: str | bytes, contract: Contract) -> Reply:
    return read_reply(_unpacked(answer), len(contract.action))


def _unpacked(message: str | bytes) -> Any:
    if isinstance(message, str):  # openpi's servers send a traceback
        last = (message.strip().splitlines() or [""])[-1]
        raise ValueError(f"the server failed: {last}")  # noqa: TRY004 -- the message is wrong, not the type
    return unpack(message)


def _cut(server: ClientConnection) -> None:
    """Close a connection without a word: a server that hangs would not hear it."""
    with contextlib.suppress(OSError):
        server.socket.shutdown(socket.SHUT_RDWR)
    server.close()


def _shown(uri: str) -> str:
    """Return an address without user name and password."""
    scheme, _, rest = uri.partition("://")
    return f"{scheme}://{rest.rpartition('@')[2]}"


def _sentence(error: Exception) -> str:
    """Return an error's first line, short and printable."""
    from websockets.exceptions import ConnectionClosed

    said = str(error).strip().partition("\n")[0][:200] or type(error).__name__
    said = "".join(letter if letter.isprintable() else "?" for letter in said)
    return f"the server is gone ({said})" if isinstance(error, ConnectionClosed) else said
