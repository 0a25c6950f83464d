"""Text stays text, whatever is in it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.report.markup import Html, join, tag
from tests.report.pages import HOSTILE, Page

printable = st.text(st.characters(exclude_categories=["C", "Z"]) | st.sampled_from(" <>&\"'=/"))


@given(printable)
def test_a_text_is_shown_as_it_is_and_makes_no_element(text):
    page = Page(tag("p", text))
    assert [name for name, _ in page.tags] == ["p"]
    assert page.text == text


@given(printable)
def test_an_attribute_keeps_its_value_and_makes_no_other(text):
    assert Page(tag("i", style=text)).tags == [("i", {"style": text})]


@given(st.text())
def test_whatever_is_in_a_text_there_is_one_element(text):
    assert [name for name, _ in Page(tag("p", text, tag("b", text))).tags] == ["p", "b"]


@pytest.mark.parametrize("hidden", ["\u202e", "\u200b", "\x00", "\x1b", "\udc80", "\u2066"])
def test_what_cannot_be_seen_is_shown_as_a_mark_that_can(hidden):
    assert tag("p", f"a{hidden}b") == "<p>a\ufffdb</p>"


def test_html_that_passes_through_an_ordinary_operation_is_text_again():
    assert tag("p", tag("b") + HOSTILE) == tag("p", f"<b></b>{HOSTILE}")
    assert "<script" not in tag("p", Html("<b></b>") + HOSTILE)


def test_parts_are_escaped_one_by_one():
    assert join(["<", Html("<br>"), "&"]) == "&lt;<br>&amp;"


def test_names_of_attributes_are_written_as_html_has_them_and_none_is_left_out():
    assert tag("p", None, class_="a", aria_label="b", style=None) == '<p class="a" aria-label="b"></p>'
