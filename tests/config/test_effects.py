"""The effects of a virtual world, as a user writes them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.config.effects import NONE, Effects
from adatracker_deploy.core.errors import UsageError


@given(
    st.just(0.0) | st.floats(5.0, 100_000.0), st.sampled_from(("smooth", "A", "B", "C", "D")), st.booleans()
)
def test_what_is_written_is_read_again(fog_m, road, sit):
    effects = Effects(fog_m=fog_m, road=road, sit=sit)
    assert Effects.read(str(effects)) == effects


def test_nothing_is_no_effect():
    assert Effects.read("") == NONE


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("snow", "'snow' is none of fog"),
        ("fog", "'fog' is none of fog"),
        ("fog=thick", "'fog=thick' is none of fog"),
        ("fog=nan", "'fog=nan' is none of fog"),
        ("fog=4", "optical range of 5 to"),
        ("road=E", "road 'E': expected smooth, A"),
        ("sit=1", "'sit=1' is none of fog"),
    ],
)
def test_what_is_no_effect_is_refused(text, why):
    with pytest.raises(UsageError, match=why):
        Effects.read(text)
