"""GroundingDINO's caption, and which of its tokens belong to which word. Pure functions.

Words are joined as "person . obstacle ."; tokens attend only within their own phrase, which ends with its
full stop, and are numbered anew in each (`groundingdino/models/GroundingDINO/bertwarper.py`,
generate_masks_with_special_tokens_and_transfer_map).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.models.wordpiece import CLS, PADDING, SEP, UNKNOWN, WordPiece

MOST_TOKENS = 256
"""Longest caption that the text side of the published weights reads (max_text_len)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Caption:
    """The tokens of some words, T of them."""

    ids: NDArray[np.int64]
    """Shape (T,): [CLS], the words each with its full stop, [SEP], and [PAD] up to the length asked for."""
    real: NDArray[np.bool_]
    """Shape (T,): no padding."""
    positions: NDArray[np.int64]
    """Shape (T,): place within the phrase."""
    attend: NDArray[np.bool_]
    """Shape (T, T): which tokens see each other."""
    spans: tuple[slice, ...]
    """The tokens of each word, without its full stop."""


def caption(words: Sequence[str], vocabulary: WordPiece, length: int | None, *, where: str) -> Caption:
    """Write the caption of some words.

    Args:
        words: at least one.
        vocabulary: of the text encoder.
        length: tokens that the graph takes; None where it takes any number.
        where: the model's path, for errors.

    Raises:
        UsageError: no words; one holds a full stop, is nothing or is unknown to the vocabulary; too many.
    """
    if not words:
        raise UsageError(f"{where}: needs a prompt: give it words, for example person")
    ids = vocabulary.ids
    tokens, spans, ends = [ids[CLS]], [], [0]
    for word in words:
        pieces = vocabulary.encode(word)
        if not pieces or ids["."] in pieces or ids[UNKNOWN] in pieces:
            raise UsageError(f"{where}: the word {word!r} cannot be written in its vocabulary")
        spans.append(slice(len(tokens), len(tokens) + len(pieces)))
        tokens += [*pieces, ids["."]]
        ends.append(len(tokens) - 1)
    tokens.append(ids[SEP])
    ends.append(len(tokens) - 1)
    total = length or len(tokens)
    if len(tokens) > min(total, MOST_TOKENS):
        raise UsageError(
            f"{where}: {len(words)} words are {len(tokens)} tokens; it reads {min(total, MOST_TOKENS)}"
        )
    real = np.arange(total) < len(tokens)
    positions, attend = np.zeros(total, np.int64), np.eye(total, dtype=bool)
    for before, end in pairwise(ends):
        phrase = slice(before + 1, end + 1)
        positions[phrase] = np.arange(end - before)
        attend[phrase, phrase] = True
    padded = np.full(total, ids[PADDING], np.int64)
    padded[: len(tokens)] = tokens
    return Caption(ids=padded, real=real, positions=positions, attend=attend, spans=tuple(spans))
