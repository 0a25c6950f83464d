"""Reading back what was cut short, damaged, or never a trial."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.trial.folder import FILE_NAME, PART_NAME
from adatracker_deploy.trial.reader import find_trials, read_scored, read_trial, trial_file
from tests.trial.records import a_step, a_trial, scored

STEPS = 6
reuses_a_file = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = a_trial(tmp_path_factory.mktemp("trials"), [a_step(step) for step in range(STEPS)])
    return folder / "trial.mcap"


@reuses_a_file
@given(data=st.data())
def test_a_file_cut_anywhere_is_read_up_to_its_last_whole_record(whole, tmp_path, data):
    content = whole.read_bytes()
    first_step = content.index(b'{"step"')
    length = data.draw(st.integers(0, len(content) - 1))
    file = tmp_path / "trial.mcap.part"
    file.write_bytes(content[:length])
    try:
        trial = read_trial(file)
    except UsageError:
        assert length < first_step, "only a file without its first records may be refused"
        return
    assert trial.complete is (length >= len(content) - len(MCAP0_MAGIC))
    assert list(trial.steps) == [a_step(step) for step in range(len(trial.steps))]
    assert len(list(trial.frames())) in (len(trial.steps), len(trial.steps) + 1)


@reuses_a_file
@given(at=st.floats(0, 1, exclude_max=True), noise=st.binary(min_size=1, max_size=12))
def test_a_damaged_file_is_read_or_refused(whole, tmp_path, at, noise):
    content = bytearray(whole.read_bytes())
    start = int(at * len(content))
    content[start : start + len(noise)] = noise
    file = tmp_path / "trial.mcap"
    file.write_bytes(content)
    with contextlib.suppress(UsageError):
        list(read_trial(file).frames())


def test_bytes_of_an_interrupted_disk_at_the_end_do_no_harm(whole, tmp_path):
    file = tmp_path / "trial.mcap.part"
    content = whole.read_bytes()
    end_of_data = content.index(b"\x07\x00\x00\x00summary") - 9  # the record's opcode and length
    file.write_bytes(content[:end_of_data] + bytes(4096))
    assert len(read_trial(file).steps) == STEPS


@pytest.mark.parametrize(
    ("content", "reason"),
    [(b"", "not an MCAP file"), (b"PK\x03\x04 a zip file", "not an MCAP file")],
)
def test_other_files_are_refused(tmp_path, content, reason):
    file = tmp_path / "other"
    file.write_bytes(content)
    with pytest.raises(UsageError, match=reason):
        read_trial(file)


def test_somebody_elses_mcap_is_refused(tmp_path):
    with (tmp_path / "trial.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("pose", "jsonschema", b"{}")
        channel = writer.register_channel("/pose", "json", schema)
        writer.add_message(channel, 1, json.dumps({"x": 1}).encode(), 1)
        writer.finish()
    with pytest.raises(UsageError, match="not a trial of this toolkit"):
        read_trial(tmp_path)


def test_what_is_not_there_is_said(tmp_path):
    with pytest.raises(UsageError, match="no such file or folder"):
        read_trial(tmp_path / "nothing")
    with pytest.raises(UsageError, match=r"no trial\.mcap in it"):
        read_trial(tmp_path)


def test_a_log_of_a_newer_format_asks_for_an_update(whole, tmp_path):
    file = tmp_path / "trial.mcap"
    content = whole.read_bytes()
    assert content.count(b"step_format\x01\x00\x00\x002") == 1
    file.write_bytes(content.replace(b"step_format\x01\x00\x00\x002", b"step_format\x01\x00\x00\x009"))
    with pytest.raises(UsageError, match="newer version"):
        read_trial(file)


def test_a_log_of_an_older_format_says_what_would_read_it(whole, tmp_path):
    file = tmp_path / "trial.mcap"
    file.write_bytes(
        whole.read_bytes().replace(b"step_format\x01\x00\x00\x002", b"step_format\x01\x00\x00\x000")
    )
    with pytest.raises(
        UsageError, match=r"older version .* step format 0.* score it with adatracker-deploy \d"
    ):
        read_scored(file)


def test_scoring_reads_of_every_tick_what_reading_it_whole_gives(whole):
    trial, marks = read_trial(whole), read_scored(whole)
    for name in ("path", "planned_steps", "config", "summary", "events", "complete"):
        assert getattr(marks, name) == getattr(trial, name)
    for mark, record in zip(marks.steps, trial.steps, strict=True):
        assert mark == scored(record)


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
def test_a_file_that_other_tools_rewrote_in_chunks_reads_the_same(whole, tmp_path, compression):
    file = tmp_path / "trial.mcap"
    rewrite(whole, file, compression)
    again, trial = read_trial(file), read_trial(whole)
    assert (again.steps, again.events, again.config) == (trial.steps, trial.events, trial.config)
    assert [frame.seq for frame in again.frames()] == [frame.seq for frame in trial.frames()]


def rewrite(source, target, compression):
    """Write a log's records again as the public tools do by default: in compressed chunks."""
    with source.open("rb") as stream, target.open("wb") as out:
        writer, ids = Writer(out, compression=compression, chunk_size=2000), {}
        writer.start()
        schemas = {}
        for record in StreamReader(stream).records:
            if isinstance(record, Schema):
                schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel) and record.id not in ids:
                schema = schemas[record.schema_id]
                ids[record.id] = writer.register_channel(record.topic, record.message_encoding, schema)
            elif isinstance(record, Message):
                channel = ids[record.channel_id]
                writer.add_message(
                    channel, record.log_time, record.data, record.publish_time, record.sequence
                )
            elif isinstance(record, Metadata):
                writer.add_metadata(record.name, record.metadata)
        writer.finish()


def test_a_log_that_is_finished_while_it_is_read_is_read_on(whole, tmp_path):
    """A killed tracker's writer may finish the log between two of a report's looks into it."""
    part = tmp_path / PART_NAME
    part.write_bytes(whole.read_bytes())
    trial = read_trial(part)
    part.rename(tmp_path / FILE_NAME)
    assert [mask.seq for mask in trial.masks()] == [mask.seq for mask in read_trial(whole).masks()]


def test_a_log_that_is_finished_while_it_is_looked_for_is_found(whole, tmp_path, monkeypatch):
    """It becomes whole after nobody found it whole, and before anybody sees that it was not."""
    part, is_file = tmp_path / PART_NAME, Path.is_file
    part.write_bytes(whole.read_bytes())

    def finished_meanwhile(path):
        found = is_file(path)
        if path.name == FILE_NAME and is_file(part):
            part.rename(path)
        return found

    monkeypatch.setattr(Path, "is_file", finished_meanwhile)
    assert trial_file(tmp_path).name == FILE_NAME


def test_trials_are_found_in_folders_of_folders_whole_or_not(whole, tmp_path):
    for place, name in (("b/2", "trial.mcap.part"), ("a", "trial.mcap"), ("b/1", "trial.mcap")):
        (tmp_path / place).mkdir(parents=True)
        (tmp_path / place / name).write_bytes(whole.read_bytes())
    assert find_trials(tmp_path) == [tmp_path / "a", tmp_path / "b/1", tmp_path / "b/2"]
    assert find_trials(tmp_path / "a") == [tmp_path / "a"]
    (tmp_path / "c").mkdir()
    with pytest.raises(UsageError, match="no trials in it"):
        find_trials(tmp_path / "c")


@pytest.mark.parametrize("text", ["[" * 200_000, '{"a":' * 200_000])
def test_a_summary_that_is_nested_without_end_is_refused_in_a_sentence(whole, tmp_path, text):
    builder = RecordBuilder()
    Metadata(name="summary", metadata={"json": text}).write(builder)
    content, file = whole.read_bytes(), tmp_path / "trial.mcap"
    opcode_and_length = 9
    file.write_bytes(content[: content.index(b"\7\0\0\0summary") - opcode_and_length] + builder.end())
    with pytest.raises(UsageError, match="not a trial of this toolkit"):
        read_trial(file)
