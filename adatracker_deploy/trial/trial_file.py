"""A trial's MCAP file: the messages of `channels`, and about the trial itself the metadata records.

The records are `trial`, `config` and, when the trial ended in order, `summary`.

What a policy was shown and answered is there to the bit, so that `replay` can ask it again: masks are palette
PNGs without loss; box, `action` and `context` (z) are float32 or float64 written as the shortest text that
reads back the same; the frame's time is `t_ns` less `latency.observation_age_ms`; a tick with an empty
`action` was too old to act on, and the policy was not asked; `config` has the seed of its reset and the
SHA-256 of each file of its bundle; its last action is its own answer, not what the gate sent. The pictures,
which no policy sees, are JPEG: what perception saw is there to the bit only where the camera itself sends
JPEGs, which are passed on as they came.
"""

from __future__ import annotations

from typing import IO, TYPE_CHECKING

from mcap.writer import CompressionType, IndexType, Writer

from adatracker_deploy.trial.channels import Encoder, channels
from adatracker_deploy.trial.ipc import Picture

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import numpy as np
    from numpy.typing import NDArray

    from adatracker_deploy.core.messages import ClassMask
    from adatracker_deploy.core.record import StepRecord
    from adatracker_deploy.trial.channels import Message


class TrialFile:
    """Writes a trial into an open stream; without compression and chunks, so that every record stands alone.

    Args:
        stream: anything with `write` and `tell`.
        metadata: records by name, each a mapping of texts.
    """

    def __init__(self, stream: IO[bytes], metadata: Mapping[str, Mapping[str, str]]) -> None:
        self._mcap = start_mcap(stream)
        for name, record in metadata.items():
            self._mcap.add_metadata(name, dict(record))
        self._channels: dict[str, int] = {}
        for channel in channels():
            schema = self._mcap.register_schema(channel.schema_name, channel.schema_encoding, channel.schema)
            self._channels[channel.topic] = self._mcap.register_channel(
                channel.topic, channel.encoding, schema
            )
        self._encoder = Encoder()

    def picture(
        self, wall_ns: int, captured_ns: int, seq: int, rgb: NDArray[np.uint8], mask: ClassMask
    ) -> None:
        """Write a frame, RGB uint8 (H, W, 3), and its mask."""
        picture = Picture((rgb.shape[1], rgb.shape[0]), rgb, mask)
        self.write(self._encoder.picture(wall_ns, captured_ns, seq, picture))

    def step(self, wall_ns: int, captured_ns: int, record: StepRecord) -> None:
        """Write a tick."""
        self.write(self._encoder.step(wall_ns, captured_ns, record))

    def event(self, wall_ns: int, level: str, message: str) -> None:
        """Write an event."""
        self.write(self._encoder.event(wall_ns, level, message))

    def write(self, messages: Iterable[Message]) -> None:
        """Write what an encoder of the caller's made of it."""
        for topic, wall_ns, data, sequence in messages:
            self._mcap.add_message(self._channels[topic], wall_ns, data, wall_ns, sequence)

    def finish(self, summary_json: str | None) -> None:
        """Write the summary, if the trial has one, and the file's index."""
        if summary_json is not None:
            self._mcap.add_metadata("summary", {"json": summary_json})
        self._mcap.finish()


def start_mcap(stream: IO[bytes]) -> Writer:
    """Begin an MCAP file whose records each stand alone."""
    mcap = Writer(
        stream, compression=CompressionType.NONE, use_chunking=False, index_types=IndexType.METADATA
    )
    mcap.start(library="adatracker-deploy")
    return mcap
