"""BERT's uncased tokeniser over a user's vocab.txt: basic tokens, then the longest known pieces.

After "BERT: Pre-training of Deep Bidirectional Transformers" and its reference code's `tokenization.py`:
control characters are dropped, accents stripped, letters lowered, punctuation and CJK characters stand alone;
a word is cut greedily into the longest pieces of the vocabulary, the second and later ones written with ## in
front.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from adatracker_deploy.core.errors import UsageError

CLS, SEP, UNKNOWN, PADDING = "[CLS]", "[SEP]", "[UNK]", "[PAD]"
_LONGEST_WORD = 100
_CAP_BYTES = 8 << 20
_CJK = (
    (0x4E00, 0x9FFF),
    (0x3400, 0x4DBF),
    (0x20000, 0x2A6DF),
    (0x2A700, 0x2B73F),
    (0x2B740, 0x2B81F),
    (0x2B820, 0x2CEAF),
    (0xF900, 0xFAFF),
    (0x2F800, 0x2FA1F),
)


@dataclass(frozen=True, slots=True)
class WordPiece:
    """A vocabulary: pieces to their numbers."""

    ids: dict[str, int]

    @classmethod
    def read(cls, path: Path) -> WordPiece:
        """Read a vocab.txt: one piece a line, its number the line's.

        Raises:
            UsageError: it cannot be read, or is no BERT vocabulary.
        """
        try:
            if path.stat().st_size > _CAP_BYTES:
                raise UsageError(f"{path}: is larger than {_CAP_BYTES >> 20} MiB")
            lines = path.read_text("utf-8").split("\n")
        except (OSError, UnicodeDecodeError) as error:
            raise UsageError(f"{path}: cannot be read as a vocabulary: {error}") from error
        ids = {line.rstrip("\r"): number for number, line in enumerate(lines) if line.rstrip("\r")}
        if missing := [piece for piece in (CLS, SEP, UNKNOWN, PADDING, ".") if piece not in ids]:
            raise UsageError(f"{path}: is not a BERT vocabulary: it lacks {missing[0]!r}")
        return cls(ids)

    def encode(self, text: str) -> list[int]:
        """Return the numbers of a text's pieces, without [CLS] and [SEP]."""
        return [self.ids[piece] for word in _words(text) for piece in self._pieces(word)]

    def _pieces(self, word: str) -> list[str]:
        pieces: list[str] = []
        start = 0
        while start < len(word) <= _LONGEST_WORD:
            front = "##" if start else ""
            end = next((e for e in range(len(word), start, -1) if front + word[start:e] in self.ids), start)
            if end == start:
                return [UNKNOWN]
            pieces.append(front + word[start:end])
            start = end
        return pieces or [UNKNOWN]


def _words(text: str) -> Iterator[str]:
    word = ""
    for character in _plain(text):
        alone = _is_punctuation(character) or any(low <= ord(character) <= high for low, high in _CJK)
        if (alone or character == " ") and word:
            yield word
            word = ""
        if alone:
            yield character
        elif character != " ":
            word += character
    if word:
        yield word


def _plain(text: str) -> Iterator[str]:
    """Yield lower-case characters without accents or controls; every kind of space as a space."""
    for character in unicodedata.normalize("NFD", text.lower()):
        kind = unicodedata.category(character)
        if character in "\t\n\r" or kind == "Zs":
            yield " "
        elif kind != "Mn" and not kind.startswith("C") and character != "\ufffd":
            yield character


def _is_punctuation(character: str) -> bool:
    code = ord(character)
    ascii_symbol = 33 <= code <= 47 or 58 <= code <= 64 or 91 <= code <= 96 or 123 <= code <= 126
    return ascii_symbol or unicodedata.category(character).startswith("P")
