"""Plain box files in every dialect that trackers write."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Box
from adatracker_deploy.scoring.box_file import BoxOptions, BoxTrack, read_boxes

SIZE = BoxOptions(image_size=(100, 50))
BOX = Box(0.2, 0.6, 0.2, 0.4)
"""The line x,y,w,h = 10,20,20,20 in that image."""
MOT = """\
1,4,0,0,9,9,1,-1,-1,-1
2,3,10,20,20,20,1,-1,-1,-1
4,3,10,20,20,20,1,-1,-1,-1
6,4,0,0,9,9,1,-1,-1,-1
"""


def track(tmp_path, text, options=SIZE, name="boxes.txt"):
    (tmp_path / name).write_bytes(text.encode())
    return read_boxes(tmp_path / name, options)


@pytest.mark.parametrize(
    "text",
    [
        "10,20,20,20\n0,0,0,0\n10,20,20,20\n",
        "10 20 20 20\r\n0 0 0 0\r\n10 20 20 20",
        "10\t20\t20\t20\n0\t0\t0\t0\n10\t20\t20\t20\n\n\n",
        "10; 20; 20; 20\n0; 0; 0; 0\n10; 20; 20; 20\n",
        "\ufeff10.0,20.0,2e1,20,\n 0, 0, 0, 0,\n10.0,20.0,20.0,20.0,\n",
        "x,y,w,h\n10,20,20,20\n0,0,0,0\n10,20,20,20\n",
        "x y width height\n10,20,20,20\n10,20,0,20\n10,20,20,20\n",
        "1,1,10,20,20,20\n3,1,10,20,20,20\n",
        "1,1,10,20,20,20,0.9\n2,1,1,1,1,1,0\n3,1,10,20,20,20,-1\n",
        "frame,id,x,y,w,h,conf\n5,1,10,20,20,20,1\n7,1,10,20,20,20,1\n",
    ],
)
def test_every_dialect_says_the_same(tmp_path, text):
    assert track(tmp_path, text) == BoxTrack((BOX, None, BOX), None)


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("0,0,640,360\n", (640, 360)),
        ("1,1,640,360\n", (640, 360)),  # counted from 1
        ("0,0,640,362\n", (640, 480)),
        ("600,300,100,50\n0,0,0,0\n", (768, 576)),
        ("10,10,20,20\n-5,0,9000,nan\n", (320, 240)),
        ("0.2,0.3,0.5,0.7\n", (1, 1)),
        ("4000,3000,500,500.5\n", (4500, 3501)),
        ("3,1,600,300,100,50\n", (768, 576)),
        ("0,0,0,0\n", (1, 1)),
    ],
)
def test_an_unknown_size_is_the_smallest_usual_one_that_holds_every_box(tmp_path, text, size):
    assert track(tmp_path, text, BoxOptions()).assumed_size == size
    assert track(tmp_path, text).assumed_size is None


def test_a_mot_track_begins_with_its_target_and_ends_with_the_sequence(tmp_path):
    found = track(tmp_path, MOT, BoxOptions(image_size=(100, 50), target=3))
    assert found.boxes == (BOX, None, BOX, None, None)


def test_a_sequence_description_gives_size_rate_and_length(tmp_path):
    (tmp_path / "gt").mkdir()
    (tmp_path / "seqinfo.ini").write_text(
        "[Sequence]\nframeRate=7\nseqLength=8\nimWidth=100\nimHeight=50\nname=50% more\n"
    )
    found = track(tmp_path / "gt", MOT, BoxOptions(target=3))
    assert found == BoxTrack((BOX, None, BOX, None, None, None, None), 7.0)
    assert track(tmp_path / "gt", MOT, BoxOptions(target=3, rate_hz=5.0)).rate_hz == 5.0


@pytest.mark.parametrize(
    ("text", "options", "reason"),
    [
        ("", SIZE, "is empty"),
        ("\n\n", SIZE, "is empty"),
        ("x,y,w,h\n", SIZE, "has no boxes"),
        ("1,2,3\n", SIZE, "line 1: expected x,y,w,h"),
        ("1,2,3,4,5,6,7,8\n", SIZE, "line 1: expected x,y,w,h"),
        ("1,2,3,4\n\n1,2,3,4\n", SIZE, "line 2: expected the 4 numbers"),
        ("1,2,3,4\n1,1,1,2,3,4\n", SIZE, "line 2: expected the 4 numbers"),
        ("1,2,3,4\n", BoxOptions(image_size=(9, 9), target=1), "--id is for MOT files"),
        (MOT, SIZE, "has several targets: choose one with --id, of 3, 4"),
        (MOT, BoxOptions(image_size=(9, 9), target=5), "has no target 5"),
        ("1,1,1,1,1,1,0\n", SIZE, "no box of a confidence above 0"),
        ("1,1,1,1,1,1\n1,1,1,1,1,1\n", SIZE, "two boxes in frame 1"),
        ("1.5,1,1,1,1,1\n", SIZE, "whole numbers"),
        ("nan,1,1,1,1,1\n", SIZE, "whole numbers"),
    ],
)
def test_anything_else_is_refused_with_its_place(tmp_path, text, options, reason):
    with pytest.raises(UsageError, match=reason):
        track(tmp_path, text, options)


def test_a_foreign_sequence_description_is_refused(tmp_path):
    (tmp_path / "seqinfo.ini").write_text("nothing of the kind")
    with pytest.raises(UsageError, match=r"not a seqinfo\.ini"):
        track(tmp_path, MOT, BoxOptions(target=3))


@given(text=st.text(st.sampled_from("0123456789.,;- \t\nenaix")))
def test_any_text_is_read_or_refused(tmp_path_factory, text):
    folder = tmp_path_factory.getbasetemp()
    try:
        found = track(folder, text)
    except UsageError:
        return
    assert found.boxes
