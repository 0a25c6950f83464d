"""The runtime answers as the definition says, whatever the interface, and forgets everything at a reset."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import MaskClass, Observation
from adatracker_deploy.policy.bundle import load_bundle
from adatracker_deploy.policy.drawing import MaskPainter
from adatracker_deploy.policy.onnx_policy import OnnxPolicy
from tests.policy import tiny

INTERFACES = ("streaming", "window", "none")


@pytest.fixture(scope="module")
def policies(tmp_path_factory):
    def load(interface):
        folder = tmp_path_factory.mktemp(interface)
        tiny.Parts(interface).write(folder)
        return OnnxPolicy(load_bundle(folder))

    return {interface: load(interface) for interface in INTERFACES}


def run(policy, masks):
    policy.reset()
    steps = [policy.step(mask) for mask in masks]
    return np.array([action for action, _ in steps]), [z for _, z in steps]


@pytest.mark.parametrize("interface", INTERFACES)
@given(ticks=st.integers(1, 3 * tiny.HISTORY), seed=st.integers(0, 1000))
def test_every_tick_is_answered_from_this_mask_and_the_pairs_before_it(policies, interface, ticks, seed):
    masks = tiny.masks(ticks, seed)
    actions, contexts = run(policies[interface], masks)
    wanted_actions, wanted_contexts = tiny.answers(masks, interface)
    np.testing.assert_allclose(actions, wanted_actions, atol=1e-5)
    if interface == "none":
        assert contexts == [None] * ticks
    else:
        np.testing.assert_allclose(contexts, wanted_contexts, atol=1e-5)


@given(ticks=st.integers(1, 40), seed=st.integers(0, 1000))
def test_streaming_and_window_agree_to_rounding(policies, ticks, seed):
    masks = tiny.masks(ticks, seed)
    streaming, window = (run(policies[name], masks) for name in ("streaming", "window"))
    np.testing.assert_allclose(streaming[0], window[0], atol=1e-5)
    np.testing.assert_allclose(streaming[1], window[1], atol=1e-5)


@pytest.mark.parametrize("interface", INTERFACES)
def test_a_reset_leaves_nothing_of_the_last_episode(policies, interface):
    policy = policies[interface]
    first, _ = run(policy, tiny.masks(12))
    run(policy, tiny.masks(30, seed=5))
    again, _ = run(policy, tiny.masks(12))
    np.testing.assert_array_equal(first, again)


@pytest.mark.parametrize("interface", INTERFACES)
def test_the_callers_buffer_may_be_reused_and_answers_stay_as_given(policies, interface):
    policy, masks = policies[interface], tiny.masks(10)
    fresh, _ = run(policy, masks)
    policy.reset()
    buffer, kept = np.empty_like(masks[0]), []
    for mask in masks:
        buffer[:] = mask
        kept.append(policy.step(buffer)[0])
    np.testing.assert_array_equal(fresh, kept)


@pytest.mark.parametrize("interface", INTERFACES)
def test_an_observation_is_painted_in_the_episodes_colour_and_answered(policies, interface):
    policy = policies[interface]
    seen = np.zeros((48, 64), np.uint8)
    seen[10:40, 20:30], seen[:, 50:] = MaskClass.TARGET, MaskClass.PERSON
    policy.reset(seed=3)
    action = policy.act(Observation(mask=seen, box=None, confidence=1.0, t_ns=0, seq=0))
    wanted, z = tiny.answers(MaskPainter(tiny.MASK, seed=3).paint(seen)[None], interface)
    np.testing.assert_allclose(action.values, wanted[0], atol=1e-5)
    assert action.values.dtype == np.float32
    if interface == "none":
        assert action.context is None
    else:
        np.testing.assert_allclose(action.context, z[0], atol=1e-5)


def test_it_is_what_its_manifest_says_with_the_digest_of_every_file(policies):
    info = policies["streaming"].info
    assert (info.name, info.rate_hz) == ("tiny", 10.0)
    assert [entry.axis for entry in info.action] == ["yaw", "forward"]
    assert {name for name, _ in info.sha256} == {
        "manifest.yaml",
        "policy.onnx",
        "encoder.onnx",
        "golden.npz",
    }
    assert all(len(digest) == 64 for _, digest in info.sha256)


def test_the_networks_run_on_the_callers_thread_alone(tmp_path):
    tiny.Parts().write(tmp_path)
    bundle, tasks = load_bundle(tmp_path), Path("/proc/self/task")
    before = set(tasks.iterdir())
    policy = OnnxPolicy(bundle)
    run(policy, tiny.masks(5))
    assert set(tasks.iterdir()) <= before


@pytest.mark.parametrize("name", ["action", "z"])
@pytest.mark.parametrize("tick", [0, 23])
def test_answers_that_differ_from_the_golden_ones_are_refused(tmp_path, name, tick):
    parts = tiny.Parts()
    parts.golden[name][tick, 0] += 2e-4
    parts.write(tmp_path)
    with pytest.raises(UsageError, match=rf"golden.npz: .*{name} differs by 0.0002 at tick {tick}"):
        OnnxPolicy(load_bundle(tmp_path))


def test_a_network_that_answers_nan_is_refused(tmp_path):
    parts = tiny.Parts("none")
    parts.policy.graph.node[-1].op_type = "Log"
    parts.write(tmp_path)
    with pytest.raises(UsageError, match="action differs by nan at tick 0"):
        OnnxPolicy(load_bundle(tmp_path))


def test_a_network_that_onnxruntime_cannot_load_is_refused(tmp_path):
    parts = tiny.Parts("none")
    parts.policy.graph.node[-1].op_type = "Tahn"
    parts.write(tmp_path)
    with pytest.raises(UsageError, match=r"policy.onnx: onnxruntime cannot load it: .*Tahn.*"):
        OnnxPolicy(load_bundle(tmp_path))


def test_a_network_that_fails_when_it_runs_is_refused(tmp_path):
    parts = tiny.Parts("window")
    (rows,) = (tensor for tensor in parts.encoder.graph.initializer if tensor.name == "rows")
    rows.raw_data = np.array([1, tiny.HISTORY, 5], np.int64).tobytes()
    parts.write(tmp_path)
    with pytest.raises(UsageError, match=f"{tmp_path}.*(fail to run|cannot load)") as refused:
        OnnxPolicy(load_bundle(tmp_path))
    assert "\n" not in str(refused.value)
