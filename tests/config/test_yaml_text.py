"""YAML files, honest and hostile."""

import datetime
import re

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.config.yaml_text import DEEPEST, parse_yaml, read_yaml
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.registry import load_profile

WORDS = "aZ09 _-:#*&![]{},'\"\\ü"
PLAIN = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(WORDS, max_size=8)
DOCUMENTS = st.recursive(
    PLAIN,
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(WORDS, max_size=4), inner, max_size=3)
    ),
)


class Unshared(yaml.SafeDumper):
    def ignore_aliases(self, data):
        return True


@given(DOCUMENTS)
def test_what_is_written_out_is_read_as_it_was(document):
    text = yaml.dump(document, Dumper=Unshared, allow_unicode=True)
    assert parse_yaml(text.encode(), where="here") == document


@given(st.binary(max_size=200) | st.text(alphabet="[]{}&*!%-:?,\"'#|> \n\ta1", max_size=60).map(str.encode))
def test_any_bytes_at_all_are_read_or_refused_in_one_line(data):
    assert re.fullmatch(r"|here: not valid YAML: [^\n]*", complaint(data))


def complaint(data):
    """Return why it is refused; nothing where it is read."""
    try:
        parse_yaml(data, where="here")
    except UsageError as error:
        return str(error)
    return ""


def bomb(levels=9):
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, levels)]
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (bomb(), "an alias"),
        ("base: &b {x: 1}\nchild: {<<: *b}", "an alias"),
        ("[" * 100_000, "nested deeper|nesting"),
        ("[" * (DEEPEST + 1) + "]" * (DEEPEST + 1), "nested deeper"),
        ("limits: {forward_m_s: 1}\nlimits: {forward_m_s: 9}", "'limits' is given twice"),
        ("a: {b: 1, b: 2}", "'b' is given twice"),
        ("!!python/object/apply:os.system [true]", "could not determine a constructor"),
        ("n: " + "9" * 5000, "limit"),
        ("day: 2024-99-99", "month must be"),
        ("a: 1\n---\na: 2", "single document"),
        ("\x00", "special characters|not allowed|control"),
    ],
)
def test_a_file_that_means_harm_is_refused_in_one_line(tmp_path, text, says):
    path = tmp_path / "profile.yaml"
    path.write_text(text)
    for read in (read_yaml, lambda path: load_profile(str(path))):
        with pytest.raises(UsageError, match=says) as refusal:
            read(path)
        assert "\n" not in str(refusal.value)
        assert str(path) in str(refusal.value)


def test_depth_up_to_the_limit_is_read():
    assert parse_yaml(b"[" * DEEPEST + b"]" * DEEPEST, where="here")
    assert parse_yaml(b"when: 2024-02-29", where="here") == {"when": datetime.date(2024, 2, 29)}


def test_a_file_beyond_the_cap_is_not_even_read(tmp_path):
    path = tmp_path / "large.yaml"
    path.write_bytes(b"a" * 101)
    with pytest.raises(UsageError, match="larger than"):
        read_yaml(path, cap_bytes=100)
    assert read_yaml(path, cap_bytes=101) == "a" * 101
    with pytest.raises(UsageError, match="cannot be read"):
        read_yaml(tmp_path / "none.yaml")
