"""A few packed kilobytes that stand for gigabytes are refused by every reader, and hang none of them."""

from __future__ import annotations

import io
import shutil

import lz4.frame
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from mcap.writer import MCAP0_MAGIC

from adatracker_deploy.cli import main
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.trial.reader import read_head, read_scored, read_trial
from adatracker_deploy.trial.salvage import salvage_all
from adatracker_deploy.trial.unpack import ALWAYS_BYTES, LARGEST_CHUNK_BYTES, RATIO
from tests.trial.records import a_step, a_trial

pytestmark = pytest.mark.timeout(30)

GIANT_BYTES = 4 << 30


@pytest.fixture(scope="module")
def giant():
    """Gigabytes of zeros in some hundred kilobytes."""
    packer, packed = zstandard.ZstdCompressor().compressobj(size=GIANT_BYTES), io.BytesIO()
    zeros = bytes(64 << 20)
    for _ in range(GIANT_BYTES // len(zeros)):
        packed.write(packer.compress(zeros))
    packed.write(packer.flush())
    assert packed.tell() < 1 << 20
    return packed.getvalue()


def chunk(data, stated, compression="zstd"):
    builder = RecordBuilder()
    record = Chunk(compression, data, 0, 0, 0, stated)
    record.write(builder)
    return builder.end()


@pytest.fixture
def trial(tmp_path):
    return a_trial(tmp_path / "trials", [a_step(step) for step in range(3)])


def bombed(trial, *records):
    """Put records of a file's own making in front of a trial's."""
    file = trial / "trial.mcap"
    content = file.read_bytes()
    at = len(MCAP0_MAGIC)
    file.write_bytes(content[:at] + b"".join(records) + content[at:])
    return file


@pytest.mark.parametrize("read", [read_trial, read_scored, read_head])
def test_gigabytes_that_are_stated_are_refused_in_a_sentence(trial, giant, read):
    file = bombed(trial, chunk(giant, GIANT_BYTES))
    with pytest.raises(UsageError, match=f"claim to be {GIANT_BYTES}: no log shrinks so far") as refusal:
        read(file)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("stated", [0, 31, ALWAYS_BYTES])
def test_gigabytes_that_are_not_stated_are_damage(trial, giant, stated):
    file = bombed(trial, chunk(giant, stated))
    with pytest.raises(UsageError, match="not a trial of this toolkit"):
        read_trial(file)


def test_many_chunks_share_what_a_file_may_unpack_to(trial):
    data = zstandard.ZstdCompressor().compress(bytes(ALWAYS_BYTES // 4))
    file = bombed(trial, *[chunk(data, ALWAYS_BYTES // 4)] * 5000)
    assert file.stat().st_size * RATIO + ALWAYS_BYTES < 5000 * ALWAYS_BYTES // 4
    with pytest.raises(UsageError, match="no log shrinks so far"):
        read_trial(file)


def test_no_chunk_is_larger_than_the_largest_however_large_the_file(trial):
    file = bombed(trial, chunk(bytes(2 << 20), LARGEST_CHUNK_BYTES + 1, ""))
    with pytest.raises(UsageError, match="no log shrinks so far"):
        read_trial(file)


@pytest.mark.parametrize("data", [lz4.frame.compress(bytes(1 << 20)), b"rubbish", b""])
@pytest.mark.parametrize("compression", ["lz4", "zstd", ""])
def test_a_chunk_that_is_not_what_it_says_is_damage(trial, data, compression):
    file = bombed(trial, chunk(data, 1000, compression))
    with pytest.raises(UsageError, match="not a trial of this toolkit"):
        read_trial(file)


def test_a_compression_that_nobody_knows_is_named(trial):
    with pytest.raises(UsageError, match="unsupported compression type brotli"):
        read_trial(bombed(trial, chunk(b"?", 1, "brotli")))


def test_chunks_in_chunks_are_not_looked_into(trial, giant):
    inner = chunk(giant, GIANT_BYTES)
    assert len(read_trial(bombed(trial, chunk(inner, len(inner), ""))).steps) == 3


def test_a_run_that_finds_one_beside_it_says_so_and_goes_on(trial, giant):
    bombed(trial, chunk(giant, GIANT_BYTES)).rename(trial / "trial.mcap.part")
    sound = trial.parent / "sound"
    shutil.copytree(a_trial(trial.parent.parent / "others", [a_step(0)]), sound)
    (sound / "trial.mcap").rename(sound / "trial.mcap.part")
    told = list(salvage_all(trial.parent))
    assert [line.split(":")[0].split()[0] for line in sorted(told)] == ["salvaged", "warning"]


@pytest.mark.parametrize("command", [["score"], ["trials"], ["replay"]])
def test_the_commands_that_read_it_end(trial, giant, command, capsys):
    bombed(trial, chunk(giant, GIANT_BYTES))
    status = main([*command, str(trial)])
    out, err = capsys.readouterr()
    assert "no log shrinks so far" in out + err
    assert (status == 0) is (command == ["trials"])
