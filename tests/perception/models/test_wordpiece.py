"""Words become the numbers that BERT's uncased tokeniser gives them, and phrases keep to themselves."""

from __future__ import annotations

import numpy as np
import pytest

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.models.caption import caption
from adatracker_deploy.perception.models.wordpiece import WordPiece

PIECES = (
    "[PAD] [UNK] [CLS] [SEP] . , ' un want ##want ##ed run ##ning runn person a cafe dog 中 ! the running"
)
VOCABULARY = WordPiece({piece: number for number, piece in enumerate(PIECES.split())})
# lines of bert-base-uncased's vocab.txt, counted from 0
BERT = WordPiece(
    {"[PAD]": 0, "[UNK]": 100, "[CLS]": 101, "[SEP]": 102, ".": 1012, "the": 1996, "person": 2711, "a": 1037}
    | {"running": 2770, "dog": 3899}
)


def pieces(text):
    names = {number: piece for piece, number in VOCABULARY.ids.items()}
    return [names[number] for number in VOCABULARY.encode(text)]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "UNwanted, running!",
            ["un", "##want", "##ed", ",", "running", "!"],
        ),  # the example of BERT's own tests
        ("Café", ["cafe"]),
        ("  a\tdog\nperson\u00a0. ", ["a", "dog", "person", "."]),
        ("a中dog", ["a", "中", "dog"]),
        ("dog's", ["dog", "'", "[UNK]"]),
        ("zebra", ["[UNK]"]),
        ("dog" * 40, ["[UNK]"]),
        ("do\u200bg\u0000", ["dog"]),
        ("", []),
    ],
)
def test_text_is_cut_into_pieces(text, expected):
    assert pieces(text) == expected


def test_a_caption_has_the_published_numbers_and_places():
    said = caption(["the running dog"], BERT, None, where="m")
    assert said.ids.tolist() == [101, 1996, 2770, 3899, 1012, 102]
    assert said.positions.tolist() == [0, 0, 1, 2, 3, 0]  # as the published ONNX exporters write them
    assert said.spans == (slice(1, 4),)
    expected = np.eye(6, dtype=bool)
    expected[1:5, 1:5] = True
    np.testing.assert_array_equal(said.attend, expected)


def test_each_phrase_begins_anew_and_padding_is_told():
    said = caption(["a person", "dog"], BERT, 9, where="m")
    assert said.ids.tolist() == [101, 1037, 2711, 1012, 3899, 1012, 102, 0, 0]
    assert said.positions.tolist() == [0, 0, 1, 2, 0, 1, 0, 0, 0]
    assert said.real.tolist() == [True] * 7 + [False] * 2
    assert said.spans == (slice(1, 3), slice(4, 5))
    assert not said.attend[1:4, 4:6].any()


@pytest.mark.parametrize(
    ("words", "length", "reason"),
    [
        ([], None, "give it words"),
        (["zebra"], None, "'zebra' cannot be written"),
        (["a . dog"], None, "'a . dog' cannot be written"),
        ([" "], None, "' ' cannot be written"),
        (["person", "dog"], 5, "2 words are 6 tokens; it reads 5"),
    ],
)
def test_words_that_cannot_be_said(words, length, reason):
    with pytest.raises(UsageError, match=reason):
        caption(words, BERT, length, where="m")


def test_a_vocabulary_that_is_none(tmp_path):
    with pytest.raises(UsageError, match="cannot be read"):
        WordPiece.read(tmp_path / "none.txt")
    (tmp_path / "vocab.txt").write_text("hello\nworld\n")
    with pytest.raises(UsageError, match=r"is not a BERT vocabulary: it lacks '\[CLS\]'"):
        WordPiece.read(tmp_path / "vocab.txt")
