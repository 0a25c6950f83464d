"""The live view: publishes the log's channels on a local websocket, for Foxglove and similar viewers.

It is read-only: it offers no capability to publish, set or call. A client that reads too slowly loses the
oldest of `BACKLOG` waiting messages; neither the log nor another client ever waits for it. The server's
threads are the library's and run in the log writer's process, far from the control loop.
"""

from __future__ import annotations

import logging
import threading
from typing import TYPE_CHECKING

from adatracker_deploy.trial.channels import channels
from adatracker_deploy.trial.live_port import HOST, port_refused

if TYPE_CHECKING:
    from collections.abc import Iterable

    from adatracker_deploy.trial.channels import Message

BACKLOG = 128
"""Messages that may wait for one client: about a second at 20 Hz, of pictures of 640x480 some 1.5 MB."""
STOP_TIMEOUT_S = 0.5
"""How long the end waits for clients to take leave. The library itself would wait for as long as one that
does not read stays connected: 50 s were measured."""


class LiveView:
    """Serves messages as they come, on loopback alone.

    Args:
        port: a free one.

    Raises:
        UsageError: it is in use.
    """

    def __init__(self, port: int) -> None:
        import foxglove  # the extra: 60 ms and 27 MB

        logging.getLogger("foxglove").setLevel(logging.CRITICAL)  # stderr is the tracker's
        self._context = foxglove.Context()  # the server refers to it, but does not keep it
        self._channels = {
            channel.topic: foxglove.Channel(
                channel.topic,
                message_encoding=channel.encoding,
                schema=foxglove.Schema(
                    name=channel.schema_name, encoding=channel.schema_encoding, data=channel.schema
                ),
                context=self._context,
            )
            for channel in channels()
        }
        try:
            self._server = foxglove.start_server(
                name="adatracker-deploy",
                host=HOST,
                port=port,
                capabilities=[],
                context=self._context,
                message_backlog_size=BACKLOG,
            )
        except RuntimeError as error:
            raise port_refused(port, str(error)) from error

    def show(self, messages: Iterable[Message]) -> None:
        """Send messages to whoever is subscribed to their topics; some microseconds each, whoever reads."""
        for message in messages:
            self._channels[message.topic].log(message.data, log_time=message.wall_ns)

    def close(self) -> None:
        """Take leave of the clients, for `STOP_TIMEOUT_S` at most; the process's end frees what is left."""
        stopping = threading.Thread(target=self._server.stop, name="live view's end", daemon=True)
        stopping.start()
        stopping.join(STOP_TIMEOUT_S)
