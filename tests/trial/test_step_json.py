"""The step record as JSON and back."""

from __future__ import annotations

import dataclasses
import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.record import StepRecord
from adatracker_deploy.trial.step_json import (
    scored_step_from_json,
    step_from_json,
    step_schema,
    step_to_json,
)
from tests.trial.records import a_step, any_steps, scored

records = any_steps()


@given(records)
def test_what_is_written_is_read_back_whole_even_nan_and_infinity(record):
    assert repr(step_from_json(step_to_json(record))) == repr(record)  # repr: NaN is not equal to itself


@given(records)
def test_it_is_json_that_any_reader_accepts(record):
    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    assert json.loads(step_to_json(record), parse_constant=refuse)["step"] == record.step


def test_missing_values_are_left_out():
    written = json.loads(step_to_json(a_step(0, box=None, pose=None, battery=None)))
    assert not {"box", "pose", "battery"} & set(written)


def test_fields_of_a_newer_version_are_ignored():
    newer = json.loads(step_to_json(a_step(3))) | {"mood": "fine"}
    assert step_from_json(json.dumps(newer).encode()) == a_step(3)


@pytest.mark.parametrize("damage", ['{"step": 1}', "[]", "3", "not JSON", '{"step": "one"}'])
def test_anything_else_is_refused(damage):
    with pytest.raises(ValueError, match=r".+"):
        step_from_json(damage.encode())


def test_a_log_from_before_stages_were_measured_is_read():
    old = json.loads(step_to_json(a_step(3)))
    old["latency"] = {"observation_age_ms": 12, "infer_ms": 2, "sensor_to_command_ms": 15, "lateness_ms": 0.1}
    latency = step_from_json(json.dumps(old).encode()).latency
    assert (latency.infer_ms, latency.capture_ms, latency.wait_ms, latency.gate_ms) == (2, None, None, None)


def test_the_schema_describes_every_field():
    properties = json.loads(step_schema())["properties"]
    assert list(properties) == [field.name for field in dataclasses.fields(StepRecord)]
    assert [name for name, field in properties.items() if not field.get("description")] == []


def test_the_schema_requires_what_is_always_there():
    required = set(json.loads(step_schema())["required"])
    bare = a_step(0, box=None, sent=None, pose=None, velocity=None, battery=None, state_age_s=math.inf)
    bare = dataclasses.replace(bare, distance_m=None, bearing_rad=None, target_visible=None)
    assert required == set(json.loads(step_to_json(bare)))


@given(records)
def test_scoring_reads_of_a_record_what_reading_it_whole_gives(record):
    mark = scored_step_from_json(step_to_json(record))
    assert repr(mark) == repr(scored(record))


@pytest.mark.parametrize("data", [b"{}", b"[]", b"{", b'{"step":"one"}', b"\xff"])
def test_scoring_refuses_what_is_no_record(data):
    with pytest.raises(ValueError):  # noqa: PT011  JSON's own errors are as good
        scored_step_from_json(data)


@given(st.data())
def test_scoring_reads_a_record_whatever_order_its_fields_are_in(data):
    texts = {"mode": ',"confidence":1,"box":"\\', "gate": (',"latency":',)}
    record = a_step(7, **texts)
    shuffled = dict(data.draw(st.permutations(list(json.loads(step_to_json(record)).items()))))
    mark = scored_step_from_json(json.dumps(shuffled, separators=(",", ":")).encode())
    assert mark == scored(record)
