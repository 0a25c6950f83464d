"""A fleet's file becomes a command line for each robot, or is refused in one line."""

from __future__ import annotations

import pytest

from adatracker_deploy.cli.fleet import known_options
from adatracker_deploy.config.fleet import first_shared, parse_fleet
from adatracker_deploy.config.yaml_text import parse_yaml
from adatracker_deploy.core.errors import UsageError


def fleet(text: str):
    return parse_fleet(parse_yaml(text.encode(), where="f"), known_options(), where="f")


def test_a_robots_own_options_replace_the_common_ones():
    found = fleet(
        """
        common: {segmenter: truth, steps: 300, blur: true, fault: link_drop@5}
        robots:
          left: {platform: wheeled, profile: left.yaml, steps: 20, blur: false}
          hawk: {platform: drone, fault: [gc_pause@4, cpu_hogs@6], live: true, target: '#2', speed-cap: 0.25}
        """
    )
    left, hawk = found.robots
    assert (left.name, hawk.name, found.on_failure) == ("left", "hawk", "stop-all")
    assert left.arguments == (
        *("--segmenter=truth", "--steps=20", "--fault=link_drop@5"),
        *("--platform=wheeled", "--profile=left.yaml"),
    )
    assert hawk.arguments == (
        *("--segmenter=truth", "--steps=300", "--blur", "--fault=gc_pause@4", "--fault=cpu_hogs@6"),
        *("--platform=drone", "--live", "--target=#2", "--speed-cap=0.25"),
    )


def test_what_one_failure_means_is_the_files_choice():
    assert fleet("{on_failure: go-on, robots: {a: {platform: drone}}}").on_failure == "go-on"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[]", "f: expected a mapping"),
        ("{}", "f: missing key 'robots'"),
        ("robots: {}", "f: robots: there is none"),
        ("{robot: {}, robots: {}}", "f: unknown key 'robot'; did you mean 'robots'?"),
        ("{on_failure: stop, robots: {}}", "f: on_failure: expected one of 'stop-all', 'go-on'"),
        ("robots: {a: }", "f: robots.a: expected a mapping with text keys, got nothing"),
        ("robots: {a: {}}", "f: robots: a: missing option 'platform'"),
        ("robots: {a: {platform: }}", "f: robots: a: platform: expected text or a number, got None"),
        ("robots: {a/b: {platform: drone}}", "f: robots: a/b: a name is a letter, then"),
        ("robots: {7: {platform: drone}}", "f: robots: expected a mapping with text keys"),
        ("robots: {a: {platform: drone}, a: {platform: drone}}", "the key 'a' is given twice"),
        (
            "robots: {a: {platfrom: drone}}",
            "a: unknown option 'platfrom'; did you mean 'platform'?",
        ),
        ("{common: {stesp: 5}, robots: {}}", "f: common: unknown option 'stesp'; did you mean 'steps'?"),
        (
            "{common: {sitl: true}, robots: {}}",
            "common: 'sitl' is said for all, on the command line: --sitl",
        ),
        ("robots: {a: {log-dir: here}}", "f: robots: a: 'log-dir' is said for all"),
        ("robots: {a: {name: b}}", "f: robots: a: unknown option 'name'"),
        ("robots: {a: {together: 4}}", "f: robots: a: unknown option 'together'"),
        ("robots: {a: {blur: very}}", "f: robots: a: blur: expected true or false, got 'very'"),
        ("robots: {a: {steps: true}}", "f: robots: a: steps: expected a value, got true"),
        ("robots: {a: {steps: [5]}}", "f: robots: a: steps: expected text or a number, got [5]"),
        ("robots: {a: {fault: [true]}}", "f: robots: a: fault: expected text or a number, got True"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(text, words):
    with pytest.raises(UsageError) as refusal:
        fleet(text)
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_what_two_robots_share_is_found():
    assert first_shared({"a": "x", "b": "y", "c": "x"}) == ("a", "c")
    assert first_shared({"a": "", "b": "", "c": None, "d": None, "e": "x"}) is None
