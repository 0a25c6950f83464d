"""Walking over a log's records without decoding those that nobody wants."""

from __future__ import annotations

import struct

import pytest
from mcap.records import Message
from mcap.writer import MCAP0_MAGIC

from adatracker_deploy.trial.scan import whole_records
from tests.trial.records import a_step, a_trial


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return a_trial(tmp_path_factory.mktemp("trials"), [a_step(step) for step in range(2)]) / "trial.mcap"


def scan(path, wanted=lambda *_: True):
    with path.open("rb") as stream:
        stream.seek(len(MCAP0_MAGIC))
        return list(whole_records(stream, wanted))


def ends_of_records(content):
    at = len(MCAP0_MAGIC)
    while at < len(content) - len(MCAP0_MAGIC):
        at += 9 + struct.unpack_from("<Q", content, at + 1)[0]
        yield at


def test_a_record_that_lacks_its_last_byte_is_not_given(whole, tmp_path):
    content, file = whole.read_bytes(), tmp_path / "trial.mcap.part"
    before = 0
    for end in ends_of_records(content):
        file.write_bytes(content[: end - 1])
        assert len(scan(file)) == before
        file.write_bytes(content[:end])
        given = len(scan(file))
        assert given in (before, before + 1), "an index of the file is passed over"
        before = given


def test_only_wanted_data_are_read_and_everything_else_is_told(whole):
    every, wanted = scan(whole), scan(whole, lambda topic, seq: topic in ("/step", "/mask") and seq == 1)
    assert {topic for topic, _ in every} == {
        "", "/step", "/command", "/camera", "/mask", "/box", "/pose",
    }  # fmt: skip
    assert len(wanted) == len(every)
    read = set()
    for (topic, record), (_, lean) in zip(every, wanted, strict=True):
        if isinstance(record, Message) and lean.data:
            read.add((topic, lean.sequence))
        assert lean == record or (isinstance(record, Message) and not lean.data)
    assert read == {("/step", 1), ("/mask", 1)}
