"""Cards: a repository's README.md with the header that the Hub reads. Pure.

The keys of the header: https://huggingface.co/docs/hub/model-cards and .../datasets-cards.
"""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING, Any

import yaml

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from adatracker_deploy.policy.manifest import Manifest

LICENCES = (
    "apache-2.0", "mit", "bsd-2-clause", "bsd-3-clause", "cc0-1.0", "cc-by-4.0", "cc-by-sa-4.0",
    "cc-by-nc-4.0", "cc-by-nc-sa-4.0", "gpl-3.0", "agpl-3.0", "lgpl-3.0", "mpl-2.0", "unlicense",
)  # fmt: skip
"""Licences on the Hub (https://huggingface.co/docs/hub/repositories-licenses); any other is `other`."""
_LIBRARY = "adatracker-deploy"
_TAGS = [_LIBRARY, "robotics", "visual-tracking"]
_OPENS = "---\n"


def policy_card(manifest: Manifest, text: str, address: str) -> str:
    """Return a policy's card.

    Args:
        manifest: of its bundle.
        text: its model card; where it has none, what the manifest tells. One with a header of its own stays
            as it is.
        address: where it will be.
    """
    if text.startswith(_OPENS):
        return text
    header = {
        **_licence(manifest.licence),
        "library_name": _LIBRARY,
        "pipeline_tag": "robotics",
        "tags": [*_TAGS, "onnx"],
    }
    body = text.strip() or f"# {manifest.name}\n\n{manifest.training.strip()}"
    facts = (
        f"{manifest.rate_hz:g} Hz; drives {', '.join(axis.axis for axis in manifest.action)}; masks of "
        f"{manifest.mask.size} x {manifest.mask.size}."
    )
    use = (
        f"## Use\n\n{facts}\n\n```sh\npip install '{_LIBRARY}[hub]'\n"
        f"{_LIBRARY} --platform wheeled --sitl --policy {address}\n```\n"
    )
    return f"{_header(header)}\n{body}\n\n{use}"


def trials_card(rows: Sequence[Mapping[str, Any]], name: str, licence: str, address: str) -> str:
    """Return the card of a dataset of trials.

    Args:
        rows: of `trials.csv`, all of them.
        name: of the dataset.
        licence: an SPDX identifier.
        address: where it is.
    """
    header = {
        **_licence(licence),
        "pretty_name": name,
        "tags": [*_TAGS, "mcap"],
        "configs": [{"config_name": "trials", "data_files": "trials.csv"}],  # what the Hub's viewer shows
    }
    shown = ("trial", "platform", "kind", "policy", "outcome", "mr", "el", "steps")
    lines = [shown, ("---",) * len(shown), *([_cell(row[key]) for key in shown] for row in rows)]
    table = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    repo = address.removeprefix("hf://datasets/").partition("@")[0]
    folder = repo.partition("/")[2]
    return (
        f"{_header(header)}\n# {name}\n\nTrials of person-following policies on robots and in rehearsals: an "
        f"MCAP log each, which Foxglove opens, with its summary, its settings and the operator's marks.\n\n"
        f"{table}\n\n## Use\n\n```sh\nhf download {repo} --repo-type dataset --local-dir {folder}\n"
        f"{_LIBRARY} score {folder}/trials\n```\n"
    )


def merged(
    there: bytes | None, rows: Iterable[Mapping[str, Any]], columns: Sequence[str]
) -> list[dict[str, str]]:
    """Return the rows of a `trials.csv` with others added; a trial that is there already is replaced.

    Raises:
        ValueError: what is there is no such table.
    """
    reader = csv.DictReader(io.StringIO((there or b"").decode("utf-8")))
    if there is not None and "trial" not in (reader.fieldnames or ()):
        raise ValueError("trials.csv has no column 'trial'")
    known = {row["trial"]: {key: row.get(key) or "" for key in columns} for row in reader}
    for row in rows:
        said = {key: "" if row[key] is None else str(row[key]) for key in columns}
        known[row["trial"]] = said | {"notes": "; ".join(row["notes"])}
    return [known[trial] for trial in sorted(known)]


def as_csv(rows: Iterable[Mapping[str, str]], columns: Sequence[str]) -> bytes:
    """Return rows as a `trials.csv`."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def _licence(spdx: str) -> dict[str, str]:
    known = spdx.strip().lower()
    return {"license": known} if known in LICENCES else {"license": "other", "license_name": spdx.strip()}


def _header(values: Mapping[str, Any]) -> str:
    return f"{_OPENS}{yaml.safe_dump(dict(values), sort_keys=False, allow_unicode=True)}{_OPENS}"


def _cell(value: object) -> str:
    """Return a text that cannot break a row of a Markdown table."""
    return "".join(letter if letter.isprintable() and letter not in "|<`" else " " for letter in str(value))
