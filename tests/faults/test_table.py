"""The table names every row; its Markdown replaces one marked section and nothing else."""

from __future__ import annotations

from dataclasses import replace

import pytest
from rich.console import Console

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.faults.judge import Result
from adatracker_deploy.faults.matrix import NOT_SHOWN
from adatracker_deploy.faults.phases import TrialPhase
from adatracker_deploy.faults.table import BEGIN, END, markdown, results_table, write_markdown

ABSENT = Result(platform="drone", fault="camera_gone", says="", limit="", note="there is no server")
RESULTS = [
    Result(
        platform="wheeled",
        fault="camera_gone",
        says="it is gone",
        limit="told 0.3 s",
        value_s=0.21,
        told_s=0.21,
        onset_m_s=0.84,
        stands_s=0.55,
        stall_s=0.012,
        outcome="system_fault",
        verdict="ok",
    ),
    Result(
        platform="quadruped",
        fault="camera_gone",
        says="it is gone",
        limit="told 0.3 s",
        why="a promise",
        value_s=0.41,
        told_s=0.41,
        stands_s=0.9,
        stall_s=0.2,
        outcome="system_fault",
        verdict="LATE",
        tries=3,
    ),
    ABSENT,
]


def shown(results) -> str:
    console = Console(width=80, record=True, file=None, quiet=False)
    with console.capture() as capture:
        console.print(results_table(results))
    return capture.get()


def test_a_terminal_of_80_columns_shows_everything():
    text = shown(RESULTS)
    assert text.split("camera_gone wheeled")[1].split()[:6] == ["told", "0.3", "s", "0.21", "0.84", "0.55"]
    assert "LATE (3)" in text
    assert "drone camera_gone: there is no server" in text
    assert all(f"{name}: " in text for name in NOT_SHOWN)
    assert "…" not in text


def test_markdown_puts_robots_side_by_side_and_leaves_the_rest_of_the_file_alone(tmp_path):
    path = tmp_path / "safety.md"
    path.write_text(f"# Before\n\n{BEGIN}\nold\n{END}\n\nAfter\n")
    for _ in range(2):  # and again: nothing piles up
        write_markdown(path, RESULTS, "2030-01-02")
    text = path.read_text()
    assert text.startswith(f"# Before\n\n{BEGIN}\nWhile the robot follows, measured on 2030-01-02")
    assert text.endswith(f"{END}\n\nAfter\n")
    assert "\nold\n" not in text
    assert "| fault | what happens | limit | wheeled | quadruped | drone |" in text
    (line,) = (line for line in text.splitlines() if line.startswith("| `camera_gone`"))
    assert line == (
        "| `camera_gone` | it is gone | told 0.3 s: a promise | at 0.8, 0.21, stands 0.55 (0.01) | "
        "0.41, stands 0.90 (0.20) **LATE**: system_fault | not shown: there is no server |"
    )


def test_what_the_first_robot_lacks_is_still_explained_by_another():
    assert "| `camera_gone` | it is gone | told 0.3 s |" in markdown([ABSENT, RESULTS[0]], "2030-01-02")


@pytest.mark.parametrize("text", ["", BEGIN, f"{END}{BEGIN}", END])
def test_a_file_without_the_section_is_refused_and_left_alone(tmp_path, text):
    path = tmp_path / "safety.md"
    path.write_text(text)
    with pytest.raises(UsageError, match="has no section between"):
        write_markdown(path, RESULTS, "2030-01-02")
    assert path.read_text() == text


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(UsageError, match="cannot be read"):
        write_markdown(tmp_path / "none.md", RESULTS, "2030-01-02")


def test_faults_stand_in_the_matrix_order_and_limits_that_differ_with_their_robots():
    text = markdown(
        [
            replace(RESULTS[0], platform="drone", fault="link_stop", limit="stands 3 s", why=""),
            replace(RESULTS[0], platform="wheeled", fault="link_stop", limit="stands 2 s", why=""),
            replace(RESULTS[0], fault="camera_freeze"),
        ],
        "2030-01-02",
    )
    assert "| drone stands 3 s, wheeled stands 2 s |" in text
    assert text.index("`camera_freeze`") < text.index("`link_stop`")


CLIMBING = Result(
    platform="drone",
    fault="interrupt",
    phase=TrialPhase.CLIMBING,
    variant=" to 9 m",
    says="Ctrl-C",
    limit="climbs 0.5 s",
    value_s=0.31,
    told_s=0.0,
    stands_s=0.0,
    outcome="interrupted",
    reason="stopped by the operator",
    noticed="tracker",
    again="engages again",
    verdict="ok",
)


def test_other_phases_have_a_table_of_their_own_that_tells_who_noticed_and_what_a_second_run_did():
    text = markdown(
        [*RESULTS, CLIMBING, replace(CLIMBING, phase=TrialPhase.CONNECTING, variant="")], "2030-01-02"
    )
    first, second = text.split("In the other phases.")
    assert "`interrupt`" not in first
    lines = [line for line in second.splitlines() if "`interrupt`" in line]
    assert [line.split("|")[1].strip() for line in lines] == ["connecting", "climbing to 9 m"]
    assert "0.31, stands 0.00 (0.00); tracker: stopped by the operator; then engages again" in lines[1]


def test_a_terminal_shows_each_phase_under_its_name():
    text = shown([CLIMBING, *RESULTS])
    assert "climbing:" in text
    assert "interrupt to 9 m drone" in text
    assert text.index("climbing:") < text.index("following:") < text.index("camera_gone")
    assert "…" not in text
