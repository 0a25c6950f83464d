"""Maps requested words to a model's classes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from adatracker_deploy.core.errors import UsageError

SHOWN = 20
"""Number of known words that an error lists."""
OBSTACLES = "obstacles"
"""Stands for those of `OBSTACLE_WORDS` that a model knows, unless a sidecar declares otherwise."""
OBSTACLE_WORDS = (
    "chair, couch, bench, bed, dining table, potted plant, suitcase, refrigerator, tv, toilet, bicycle, car, "
    "motorcycle, bus, truck, fire hydrant, stop sign, parking meter, table, box, wall, pillar, fence, door, "
    "tree"
)
"""Things that a robot may hit or that hide people: of COCO's classes, and what open vocabularies add."""


def choose(
    names: Mapping[int, str], asked: Sequence[str], synonyms: Mapping[str, Sequence[str]], *, where: str
) -> dict[int, str]:
    """Say which classes are wanted, and by which of the words that were asked for.

    Args:
        names: the model's classes, by index.
        asked: words; none asks for every class by its own name.
        synonyms: words that stand for one or several of the model's classes; only what is declared counts.
        where: the model's path, for errors.

    Raises:
        UsageError: a word is neither a class nor a declared synonym, or a synonym leads nowhere; the known
            words are listed.
    """
    if not asked:
        return dict(names)
    places: dict[str, list[int]] = {}
    for index, name in names.items():
        places.setdefault(_plain(name), []).append(index)
    common = [word for word in OBSTACLE_WORDS.split(", ") if word in places]
    declared = {OBSTACLES: common} if common else {}
    declared |= {_plain(word): list(meant) for word, meant in synonyms.items()}
    chosen: dict[int, str] = {}
    for word in asked:
        for name in (word,) if _plain(word) in places else declared.get(_plain(word), (word,)):
            if _plain(name) not in places:
                raise UsageError(
                    f"{where}: does not know the word {name!r}; it knows {_some(names, synonyms)}"
                )
            for index in places[_plain(name)]:
                chosen.setdefault(index, word)
    return chosen


def _plain(word: str) -> str:
    return " ".join(word.lower().split())


def _some(names: Mapping[int, str], synonyms: Mapping[str, Sequence[str]]) -> str:
    known = list(dict.fromkeys((*synonyms, *names.values())))
    more = f" and {len(known) - SHOWN} more" if len(known) > SHOWN else ""
    return ", ".join(known[:SHOWN]) + more
