"""Only browsers on this machine that know the token may use the operator's page."""

from __future__ import annotations

import pytest

from adatracker_deploy.page.access import foreign, knows, new_token
from adatracker_deploy.page.address import Address


@pytest.mark.parametrize("host", ["127.0.0.1:8766", "localhost:1", "[::1]:8766", "LOCALHOST"])
def test_this_machines_names_are_its_own_on_any_port(host):
    assert foreign([host], []) is None
    assert foreign([host], [f"http://{host}"]) is None


@pytest.mark.parametrize(
    "hosts", [[], [""], ["evil.test"], ["127.0.0.1.evil.test"], ["127.0.0.1", "127.0.0.1"], ["127.0.0.1:x"]]
)
def test_a_foreign_name_that_leads_here_is_refused(hosts):
    assert "127.0.0.1" in foreign(hosts, [])


@pytest.mark.parametrize(
    "origin",
    [
        *("null", "", "file://", "https://127.0.0.1:8766", "http://127.0.0.1:8767", "http://localhost:8766"),
        *("https://app.foxglove.dev", "http://evil.test", "http://127.0.0.1:8766.evil.test"),
    ],
)
def test_any_page_but_its_own_is_refused(origin):
    assert "another origin" in foreign(["127.0.0.1:8766"], [origin])


@pytest.mark.parametrize(
    ("shown", "known"),
    [
        (["Bearer secret"], True),
        ([], False),
        (["secret"], False),
        (["Bearer "], False),
        (["Bearer secrets"], False),
        (["Basic secret"], False),
        (["Bearer secret", "Bearer secret"], False),
        (["Bearer s\u00e9cret"], False),
    ],
)
def test_the_token_is_known_or_not(shown, known):
    assert knows("secret", shown) is known


def test_each_address_has_a_token_of_its_own_that_is_not_printed_with_it():
    one, two = Address(8766), Address(8766)
    assert one.token != two.token
    assert len(new_token()) >= 22  # 128 bits, 6 a letter
    assert one.token not in repr(one)
    assert one.url == f"http://127.0.0.1:8766/#{one.token}"
