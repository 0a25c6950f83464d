"""The parts of a stream come out as they went in, however it is cut or its sender bends the rules."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from adatracker_deploy.perception.multipart import LARGEST_BODY_BYTES, LARGEST_HEADER_BYTES, MultipartParser

BODIES = st.lists(st.binary(max_size=200).filter(lambda body: b"next" not in body), max_size=6)
LINE_ENDS = st.sampled_from([b"\r\n", b"\n"])


def stream(bodies, end, dashes, with_length):
    lines = []
    for number, body in enumerate(bodies):
        length = [b"Content-Length: %d" % len(body)] if with_length else []
        lines += [dashes + b"next", b"Content-Type: image/jpeg", *length, b"X-Number: %d" % number, b"", body]
    return end.join([*lines, dashes + b"next"])


@given(
    BODIES,
    LINE_ENDS,
    st.sampled_from([b"--", b"----"]),
    st.booleans(),
    st.lists(st.integers(0, 2000), max_size=30),
)
@example(bodies=[b"", b""], end=b"\n", dashes=b"--", with_length=False, cuts=[])
def test_every_part_comes_out_whole_however_the_stream_is_cut(bodies, end, dashes, with_length, cuts):
    if not with_length:  # then nothing but the boundary tells where a body ends
        bodies = [body.rstrip(b"\r\n-") for body in bodies]
    data = stream(bodies, end, dashes, with_length)
    places = sorted({0, *(cut for cut in cuts if cut < len(data)), len(data)})
    for announced in ("next", "--next"):
        parser = MultipartParser(announced)
        parts = [part for a, b in pairwise(places) for part in parser.feed(data[a:b])]
        assert [part.body for part in parts] == bodies
        assert [part.headers["x-number"] for part in parts] == [str(i) for i in range(len(bodies))]


def test_byte_by_byte_is_as_good_as_at_once():
    data = stream([b"first", b"second"], b"\r\n", b"--", with_length=True)
    at_once = MultipartParser("next").feed(data)
    parser = MultipartParser("next")
    assert [part for byte in data for part in parser.feed(bytes([byte]))] == at_once
    assert len(at_once) == 2


@given(st.lists(st.binary(max_size=300), max_size=8))
def test_rubbish_is_refused_or_ignored_but_never_breaks_anything(pieces):
    parser = MultipartParser("n")
    for piece in pieces:
        try:
            parser.feed(piece)
        except ValueError:
            return


@pytest.mark.parametrize("length", ["-1", "x", "1e3", "9" * 30, "", "٣", str(LARGEST_BODY_BYTES + 1)])
def test_a_length_that_cannot_be_is_refused(length):
    with pytest.raises(ValueError, match="length is"):
        MultipartParser("next").feed(f"--next\r\nContent-Length: {length}\r\n\r\n".encode())


@pytest.mark.parametrize(
    ("beginning", "endless", "most"),
    [
        (b"", b"no boundary ", LARGEST_HEADER_BYTES),
        (b"--next\r\nX-Endless: ", b"header ", LARGEST_HEADER_BYTES),
        (b"--next\r\n\r\n", b"body without a length ", LARGEST_BODY_BYTES),
    ],
)
def test_what_never_ends_is_given_up_before_it_fills_the_memory(beginning, endless, most):
    parser = MultipartParser("next")
    parser.feed(beginning)
    piece = endless * 1000
    for _ in range(most // len(piece)):
        assert parser.feed(piece) == []
    with pytest.raises(ValueError, match=f"{most}"):
        parser.feed(piece * 2)


@pytest.mark.parametrize("boundary", ["", "--"])
def test_a_stream_without_a_boundary_is_refused(boundary):
    with pytest.raises(ValueError, match="boundary"):
        MultipartParser(boundary)
