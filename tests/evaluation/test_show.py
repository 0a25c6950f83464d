"""Tables, figure and record show the measured numbers, beside the paper's where those are comparable."""

from __future__ import annotations

import io
import json
import re
import struct
from dataclasses import replace

import pytest
from rich.console import Console

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.evaluation.grid import CELLS, Grid
from adatracker_deploy.evaluation.latex import latex_table
from adatracker_deploy.evaluation.picture import check_drawing, grid_picture, write_figure
from adatracker_deploy.evaluation.play import Played
from adatracker_deploy.evaluation.record import grid_record
from adatracker_deploy.evaluation.scores import PolicyScore, differences
from adatracker_deploy.evaluation.table import grid_table

GRID = Grid(policies=("a", "b"), episodes=2)


def played(policy, cut=None):
    """Episode `index` of the plan has AR 100 + index; those of `b` are 10 worse."""
    pairs = [
        (
            episode,
            Played(100.0 + index - (10 if policy == "b" else 0), 500, index % 4 != 0, below_floor=8.0),
        )
        for index, episode in enumerate(GRID.plan()[:cut])
        if episode.policy == policy
    ]
    return PolicyScore.of(policy, pairs)


SCORES = [played("a"), played("b")]


def shown(grid=GRID, scores=SCORES, width=80):
    out = io.StringIO()
    Console(file=out, width=width).print(grid_table(grid, scores, differences(scores)))
    return out.getvalue()


def test_the_record_holds_the_contract_and_can_be_recomputed():
    record = json.loads(json.dumps(grid_record(GRID, SCORES, differences(SCORES), 1.23), allow_nan=False))
    assert record["complete"] is True
    assert list(record["policies"]) == ["a", "b"]
    policy = record["policies"]["a"]
    assert policy["mean"].keys() == policy["interval"].keys() == policy["std"].keys() == {"ar", "el", "sr"}
    assert [(c["height_m"], c["target_speed_m_s"]) for c in policy["cells"]] == [
        (cell.height_m, cell.target_speed_m_s) for cell in CELLS
    ]
    for cell in policy["cells"]:
        for metric, key in (("ar", "ar"), ("el", "el"), ("sr", "success")):
            mean = sum(episode[key] for episode in cell["episodes"]) / len(cell["episodes"])
            assert cell[metric] == pytest.approx(mean)
            assert cell["interval"][metric][0] <= cell[metric] <= cell["interval"][metric][1]
            assert all(episode["floored_ar"] == episode["ar"] + 8 for episode in cell["episodes"])
    assert policy["floored_ar"] == pytest.approx(policy["mean"]["ar"] + 8)
    (found,) = record["differences"]
    assert (found["policy"], found["baseline"], found["episodes"]) == ("a", "b", 32)
    assert found["mean"]["ar"] == pytest.approx(9.0)
    assert record["published"]["AdaTracker"]["mean"] == {"ar": 368.0, "el": 492.0, "sr": 0.98}


def test_a_run_cut_short_is_told_as_such_and_still_json():
    scores = [played("a", cut=3)]
    record = json.loads(json.dumps(grid_record(GRID, scores, [], 0.1), allow_nan=False))
    assert (record["played"], record["complete"]) == (2, False)
    assert record["policies"]["a"]["cells"][0]["interval"]["ar"] == [None, None]
    assert "(2 of 64 episodes)" in shown(scores=scores)


def test_the_table_fits_80_columns_and_says_every_cell():
    text = shown()
    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text
    for cell in SCORES[0].cells:
        assert re.search(rf"\b{cell.metrics.ar.value:.0f}±\d+/500/{cell.metrics.sr.value:.2f}", text)
    assert "464/500/1.00" in text
    assert re.search(r"^ ?a +b +32 +\+9 \[", text, re.MULTILINE)


@pytest.mark.parametrize("change", [{"scene": "parking_lot"}, {"steps": 100}])
def test_the_papers_figures_are_not_put_beside_another_task(change):
    other = replace(GRID, **change)
    assert "paper" not in shown(other)
    assert "paper" not in latex_table(other, SCORES)
    assert "published" not in grid_record(other, SCORES, [], 1.0)


def test_every_line_of_the_latex_table_has_seven_columns():
    text = latex_table(GRID, [replace(SCORES[0], name="50%_a&b{c}"), played("b", cut=3)])
    rows = [line for line in text.splitlines() if line.endswith(r"\\") and "&" in line]
    assert len(rows) == 1 + 4 * 5
    assert {len(re.findall(r"(?<!\\)&", row)) for row in rows} == {6}
    assert r"50\%\_a\&b\{c\}" in text
    assert "& 0.3m & 324/500/1.00 & 336/500/1.00 & 240/433/0.96 & 115/494/0.94 &" in text
    assert r"$\pm$94/$\pm$17/$\pm$0.03" in text
    assert text.count(r"\begin") == text.count(r"\end") == 2
    assert text.count("{") - text.count(r"\{") == text.count("}") - text.count(r"\}")


def test_the_picture_has_a_panel_a_row_and_every_number(tmp_path):
    figure = grid_picture(GRID, [*SCORES, played("a", cut=3)])
    panels = [axes for axes in figure.axes if axes.get_title()]
    assert len(panels) == 6
    assert {text.get_text() for text in panels[0].texts} >= {"116", "500/0.00", "500/1.00"}
    assert len(panels[0].texts) == 32
    write_figure(figure, tmp_path / "grid.png")
    data = (tmp_path / "grid.png").read_bytes()
    assert struct.unpack(">II", data[16:24])[0] > 1000


@pytest.mark.parametrize(
    ("name", "words"), [("grid.pdf", "ends in .png"), ("no/such/grid.png", "there is no folder")]
)
def test_a_picture_that_cannot_be_written_is_refused_before_the_work(tmp_path, name, words):
    with pytest.raises(UsageError, match=words):
        check_drawing(tmp_path / name)


def test_a_picture_that_cannot_be_written_after_all_is_told_in_one_line(tmp_path):
    (tmp_path / "taken.png").mkdir()
    with pytest.raises(UsageError, match="cannot be written"):
        write_figure(grid_picture(GRID, SCORES), tmp_path / "taken.png")
