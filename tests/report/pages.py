"""A page as a browser would take it apart, and trials whose every text tries to break out of one."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from html.parser import HTMLParser

import yaml

from adatracker_deploy.trial.step_json import STEP_FORMAT
from adatracker_deploy.trial.trial_file import TrialFile
from tests.trial.records import START_NS, a_frame, a_step, an_observation

WALL_NS = 1_800_000_000_000_000_000
"""When the logs began."""
HOSTILE = "\"'></td></svg><script>alert(1)</script><img src=//outside.invalid/x onerror=alert(1)>&amp;\u202e"


class Page(HTMLParser):
    """Tags with their attributes, and all that is text."""

    def __init__(self, html: str) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.unclosed: list[str] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in ("img", "meta"):
            self.unclosed.append(tag)

    def handle_endtag(self, tag):
        assert self.unclosed.pop() == tag

    def handle_data(self, data):
        self.text += data

    def addresses(self) -> list[str]:
        """Everything that a browser would fetch or follow."""
        names = (
            "src",
            "href",
            "xlink:href",
            "action",
            "srcset",
            "data",
            "poster",
            "background",
            "formaction",
        )
        return [
            value or "" for _, attributes in self.tags for key, value in attributes.items() if key in names
        ]


def write_trial(
    folder, steps, *, summary=None, events=(), planned=60, policy="pid", config=None, frames=True
):
    """Write a log as the writer process does, but at once: nothing is dropped. Return its folder."""
    folder.mkdir(parents=True)
    about = {
        "step_format": str(STEP_FORMAT),
        "platform": "drone",
        "kind": "sitl",
        "policy": policy,
        "steps": str(planned),
        "started": datetime.fromtimestamp(WALL_NS / 1e9, UTC).isoformat(),
        "run_clock_ns": str(START_NS),
    }
    with (folder / "trial.mcap").open("wb") as stream:
        trial = TrialFile(stream, {"trial": about, "config": {"yaml": yaml.safe_dump(config or {"seed": 1})}})
        for step in steps:
            wall_ns = WALL_NS + step.t_ns - START_NS
            if frames:
                frame, seen = a_frame(step.frame_seq), an_observation(step.frame_seq)
                trial.picture(wall_ns, wall_ns, step.frame_seq, frame.rgb, seen.mask)
            trial.step(wall_ns, wall_ns, step)
        for level, message, time_s in events:
            trial.event(WALL_NS + round(time_s * 1e9), level, message)
        trial.finish(None if summary is None else json.dumps(summary))
    return folder


def a_varied_trial(folder):
    """Sixty steps: seen, lost, seen again, stopped, three missing, and events of every level."""
    changes = {number: {"box": None, "target": "lost"} for number in range(20, 30)}
    changes |= {number: {"gate": ("stale",), "missed_deadlines": 1} for number in range(55, 61)}
    return write_trial(
        folder,
        [a_step(number, **changes.get(number, {})) for number in (*range(45), *range(48, 61))],
        summary={"outcome": "safety_stop", "reason": "the base went silent", "stop_s": 0.4},
        events=[
            ("info", "engaging", -0.05),
            ("warning", "the wind freshens", 1.0),
            ("error", "the base went silent", 2.75),
        ],
    )


def a_hostile_trial(folder):
    """A trial that is hostile wherever a text may come from outside, its folder's name included."""
    config = {
        "profile": {"name": HOSTILE},
        "policy_sha256": {HOSTILE: HOSTILE},
        HOSTILE: HOSTILE,
        "scene": HOSTILE,
        "camera": f"http://{HOSTILE}",
    }
    return write_trial(
        folder / HOSTILE.replace("/", "|"),
        [a_step(number, mode=HOSTILE, gate=(HOSTILE,), target=HOSTILE) for number in range(6)],
        summary={"outcome": HOSTILE, "reason": HOSTILE},
        events=[("error", HOSTILE, 0.05)],
        policy=HOSTILE,
        config=config,
    )
