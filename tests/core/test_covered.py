"""How much of an image people cover, and what is made of those whom it cuts off."""

from __future__ import annotations

import numpy as np
import pytest

from adatracker_deploy.core.messages import MaskClass, covered

HEIGHT, WIDTH = 48, 64


def mask(*people, value=MaskClass.PERSON):
    """Return a mask with boxes of (top, bottom, left, right), px."""
    drawn = np.zeros((HEIGHT, WIDTH), np.uint8)
    for top, bottom, left, right in people:
        drawn[top:bottom, left:right] = value
    return drawn


def test_nobody_covers_nothing_and_the_target_is_nobody_else():
    assert covered(mask()) == covered(mask((10, 48, 0, 64), value=MaskClass.TARGET)) == 0.0


def test_who_is_whole_covers_what_they_cover():
    assert covered(mask((10, 40, 20, 28), (1, 47, 50, 51))) == (30 * 8 + 46) / (HEIGHT * WIDTH)


@pytest.mark.parametrize(("top", "bottom"), [(30, 48), (0, 20)], ids=["below", "above"])
def test_who_is_cut_off_covers_as_much_as_somebody_so_broad(top, bottom):
    """A quarter of the image is 0.98 m before a 90 degree lens, where a whole person covers a fifth."""
    assert covered(mask((top, bottom, 20, 36))) == pytest.approx(0.25**2 * 0.19 / 0.245**2)


@pytest.mark.parametrize(("bottom", "cut_off"), [(118, True), (117, False)])
def test_a_mask_may_miss_the_rim_by_a_fiftieth(bottom, cut_off):
    drawn = np.zeros((120, 160), np.uint8)
    drawn[80:bottom, 40:80] = MaskClass.PERSON
    assert (covered(drawn) == (drawn > 0).mean()) != cut_off


def test_who_is_cut_off_and_covers_more_covers_that():
    assert covered(mask((0, 48, 20, 24), (5, 40, 30, 60))) == (48 * 4 + 35 * 30) / (HEIGHT * WIDTH)


def test_the_broadest_of_those_who_are_cut_off_counts():
    here, there = (40, 48, 0, 9), (36, 48, 20, 40)
    assert covered(mask(here, there)) == covered(mask(there)) > covered(mask(here))


def test_an_image_is_not_covered_more_than_once():
    assert covered(mask((47, 48, 0, 64))) == 1.0
