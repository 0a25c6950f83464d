"""An engine against a server whose game is built here."""

from __future__ import annotations

import contextlib

import pytest

from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.sim.unreal.address import parse_address
from adatracker_deploy.sim.unreal.engine import Engine, adopt
from adatracker_deploy.sim.unreal.wire import connect
from tests.unreal.server import Game, Server


@pytest.fixture
def serve():
    """Serve worlds, one a reset; return the server, whose engine is connected and shares the game's clock."""
    with contextlib.ExitStack() as stack:

        def begin(worlds, query=""):
            clock = FakeClock()
            server = stack.enter_context(Server(Game(worlds, clock)))
            address = parse_address(server.scene(query))
            engine = Engine(connect(address.host, address.port), address, clock)
            stack.callback(engine.close)
            adopt(engine)
            return server

        yield begin
