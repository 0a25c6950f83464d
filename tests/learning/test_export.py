"""An exported bundle answers as its checkpoint does in torch, and says so; else nothing is written."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.nn import functional

from adatracker_deploy.cli import main
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.bundle_weights import networks_of
from adatracker_deploy.learning.checkpoint import OFFLINE_EVT
from adatracker_deploy.learning.export import export_checkpoint, largest_difference
from adatracker_deploy.learning.rollout import rollout, walking_masks
from adatracker_deploy.policy import belief, response
from adatracker_deploy.policy.base import ActionAxis
from adatracker_deploy.policy.bundle import load_bundle, write_bundle
from adatracker_deploy.policy.golden import GOLDEN_TOLERANCE
from adatracker_deploy.policy.onnx_policy import OnnxPolicy
from tests.learning import fresh
from tests.tiers import EXHAUSTIVE

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
PUBLISHED = ROOT.parent / "shared" / "data" / "offline_evt_public.pth"
TICKS = 30
EACH_PART = ("belief", "response", "second driver", "pooled", "no encoder, last action", "no lstm")
"""Variants that have each part, and lack each, at least once."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("export")


@pytest.fixture(scope="module")
def checkpoint(folder):
    return fresh.save_adatracker(folder / "fresh.pt")


@pytest.fixture(scope="module", params=["streaming", "window"])
def bundle(request, folder, checkpoint):
    out = folder / request.param
    export_checkpoint(checkpoint, out, interface=request.param)
    return load_bundle(out)


def answers(policy, masks):
    policy.reset()
    steps = [policy.step(mask) for mask in masks]
    return np.array([action for action, _ in steps]), np.array([z for _, z in steps])


def test_onnxruntime_answers_as_torch_on_masks_that_were_not_exported(bundle):
    masks = walking_masks(fresh.META.mask, TICKS, seed=1)
    wanted = rollout(fresh.adatracker(), masks)
    actions, contexts = answers(OnnxPolicy(bundle), masks)
    np.testing.assert_allclose(actions, wanted["action"], atol=1e-5)
    np.testing.assert_allclose(contexts, wanted["z"], atol=1e-5)


@pytest.mark.parametrize(
    "variant",
    [pytest.param(name, marks=() if name in EACH_PART else EXHAUSTIVE) for name in fresh.VARIANTS],
)
def test_every_variant_answers_as_in_torch_and_its_golden_vectors_hold(tmp_path, variant):
    config = fresh.VARIANTS[variant]
    path = fresh.save_adatracker(tmp_path / "a.pt", config=config)
    manifest = export_checkpoint(path, tmp_path / "b")
    assert (manifest.interface, manifest.context) == (
        "streaming" if config.context else "none",
        config.context,
    )
    assert ("last_action" in [tensor.name for tensor in manifest.policy.inputs]) is config.last_action
    policy, masks = OnnxPolicy(load_bundle(tmp_path / "b")), walking_masks(fresh.META.mask, TICKS, seed=1)
    wanted = rollout(fresh.adatracker(config=config), masks)
    for _ in range(2):  # a reset forgets the last action as well
        policy.reset()
        actions = np.array([policy.step(mask)[0] for mask in masks])
        np.testing.assert_allclose(actions, wanted["action"], atol=1e-5)


def test_a_last_action_changes_the_next(tmp_path):
    masks = walking_masks(fresh.META.mask, 2, seed=1)
    checkpoint = fresh.adatracker(config=fresh.VARIANTS["no encoder, last action"])
    state = None
    with torch.no_grad():
        seen = torch.from_numpy(masks)[None]
        _, _, state = checkpoint.policy(seen[:, :1], None, state, torch.zeros(1, 1, 2))
        blind, _, _ = checkpoint.policy(seen[:, 1:], None, state, torch.zeros(1, 1, 2))
    assert not np.allclose(rollout(checkpoint, masks)["action"][1], torch.tanh(blind[0, 0]), atol=1e-3)


def test_an_interface_for_an_encoder_that_is_not_there_is_refused(tmp_path):
    path = fresh.save_adatracker(tmp_path / "a.pt", config=fresh.VARIANTS["no encoder"])
    with pytest.raises(UsageError, match="has no context encoder"):
        export_checkpoint(path, tmp_path / "b", interface="window")


def test_the_golden_vectors_move_every_number_far_beyond_their_tolerance(bundle):
    for name in ("action", "z"):
        assert (np.ptp(bundle.golden[name], axis=0) > 1e-2).all(), name


def test_the_manifest_says_what_the_checkpoint_said(bundle):
    manifest = bundle.manifest
    assert (manifest.history, manifest.context) == (fresh.CONFIG.history, fresh.CONFIG.context)
    assert (manifest.name, manifest.mask, manifest.action) == ("fresh", fresh.META.mask, fresh.META.action)
    assert (manifest.rate_hz, manifest.licence) == (fresh.META.rate_hz, fresh.META.licence)
    assert largest_difference(bundle) < 1e-5


def test_the_graphs_hold_no_paths_and_no_source_lines(bundle):
    for model in (bundle.encoder, bundle.policy):
        for trace in (b".py", b"stack_trace", b"site-packages", str(ROOT).encode()):
            assert trace not in model


def test_a_bundle_whose_golden_vectors_differ_is_refused(bundle, tmp_path):
    wrong = {name: array.copy() for name, array in bundle.golden.items()}
    wrong["action"][-1, 0] += 1e-3
    manifest = replace(bundle.manifest, files={})
    write_bundle(tmp_path, manifest, encoder=bundle.encoder, policy=bundle.policy, golden=wrong)
    with pytest.raises(UsageError, match=r"action differs by 0\.001 at tick 23"):
        OnnxPolicy(load_bundle(tmp_path))


def a_believer(folder):
    config = fresh.VARIANTS["no encoder, belief"]
    export_checkpoint(fresh.save_adatracker(folder / "b.pt", config=config), folder / "b")
    return load_bundle(folder / "b")


def test_a_belief_is_in_the_manifest_and_in_the_golden_vectors(tmp_path):
    bundle = a_believer(tmp_path)
    assert bundle.manifest.believes
    told = dict(zip(belief.COLUMNS, bundle.golden["belief"].T, strict=True))
    assert set(told["seen"]) == {0.0, 1.0}  # a gap is among them
    for name in ("gap", "left", "up", "width", "height", "pace", "turned", "driven", "bearing_sin"):
        assert np.ptp(told[name]) > 50 * GOLDEN_TOLERANCE, name


def test_a_bundle_whose_belief_is_computed_otherwise_here_is_refused(tmp_path):
    bundle = a_believer(tmp_path)
    wrong = {name: array.copy() for name, array in bundle.golden.items()}
    wrong["belief"][5, belief.COLUMNS.index("turned")] += 0.01
    parts = {"encoder": None, "policy": bundle.policy, "golden": wrong}
    write_bundle(tmp_path / "c", replace(bundle.manifest, files={}), **parts)
    with pytest.raises(UsageError, match=r"belief differs by 0\.01 at tick 5"):
        OnnxPolicy(load_bundle(tmp_path / "c"))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"action": (ActionAxis(axis="forward"), ActionAxis(axis="vertical"))}, "needs forward and yaw"),
        (
            {"action": (ActionAxis(axis="forward"), ActionAxis(axis="yaw", unit="si"))},
            "needs forward and yaw",
        ),
    ],
)
def test_a_belief_without_forward_and_yaw_as_fractions_is_refused(tmp_path, changes, reason):
    bundle = a_believer(tmp_path)
    manifest = replace(bundle.manifest, files={}, **changes)
    with pytest.raises(UsageError, match=reason):
        write_bundle(tmp_path / "c", manifest, encoder=None, policy=bundle.policy, golden=bundle.golden)


def test_a_policy_that_is_told_nothing_of_its_past_may_drive_other_axes(tmp_path):
    action = (ActionAxis(axis="forward"), ActionAxis(axis="vertical"))
    meta = replace(fresh.META, action=action)
    export_checkpoint(fresh.save_adatracker(tmp_path / "v.pt", meta=meta), tmp_path / "v")
    assert OnnxPolicy(load_bundle(tmp_path / "v")).info.action == action


def test_a_response_continues_the_golden_contexts(tmp_path):
    config = fresh.VARIANTS["response"]
    export_checkpoint(fresh.save_adatracker(tmp_path / "r.pt", config=config), tmp_path / "r")
    bundle = load_bundle(tmp_path / "r")
    assert bundle.manifest.response
    told = dict(zip(response.COLUMNS, bundle.golden["z"][:, config.context :].T, strict=True))
    for name in ("evidence", "turn_under_way", "drive_under_way", "bearing_then"):
        assert np.ptp(told[name]) > 50 * GOLDEN_TOLERANCE, name
    manifest = replace(bundle.manifest, files={}, response=False)
    with pytest.raises(UsageError, match=r"policy\.inputs"):
        write_bundle(
            tmp_path / "c", manifest, encoder=bundle.encoder, policy=bundle.policy, golden=bundle.golden
        )


def test_a_response_without_a_context_to_continue_is_refused(tmp_path):
    bundle = a_believer(tmp_path)
    manifest = replace(bundle.manifest, files={}, response=True, encoder=None)
    with pytest.raises(UsageError, match="response without an encoder"):
        write_bundle(tmp_path / "c", manifest, encoder=None, policy=bundle.policy, golden=bundle.golden)


def searching(tmp_path, variant="response"):
    path = fresh.save_adatracker(tmp_path / "s.pt", config=fresh.VARIANTS[variant])
    assert main(["export-onnx", str(path), "--search", "--out", str(tmp_path / "s")]) == 0
    return load_bundle(tmp_path / "s")


def test_a_policy_that_searches_turns_until_its_target_is_back_and_knows_that_it_turned(tmp_path):
    bundle = searching(tmp_path)
    assert bundle.manifest.search
    policy, masks = OnnxPolicy(bundle), bundle.golden["mask"]
    for mask in masks:
        policy.step(mask)
    gone = np.zeros_like(masks[0])
    actions = [policy.step(gone)[0].tolist() for _ in range(60)]
    began = next(step for step, action in enumerate(actions) if action in ([0, 1], [0, -1]))
    assert 0 < began < 50
    assert all(action == actions[began] for action in actions[began:])
    told = dict(zip(belief.COLUMNS, policy.belief, strict=True))
    turned = -actions[began][1]  # fresh's yaw is positive to the right
    assert told["turned"] * turned > 0.8
    back, _ = policy.step(masks[0])
    assert back.tolist() != actions[began]


def test_training_that_begins_with_a_policy_that_searches_gives_back_that_it_does(tmp_path):
    assert networks_of(searching(tmp_path)).meta.search


def test_a_policy_without_a_belief_cannot_be_made_to_search(checkpoint, tmp_path, capsys):
    assert main(["export-onnx", str(checkpoint), "--search", "--out", str(tmp_path / "s")]) == 2
    assert "was trained without a belief, which tells when to search" in capsys.readouterr().err
    assert not (tmp_path / "s").exists()
    bundle = a_believer(tmp_path)
    graph = replace(
        bundle.manifest.policy,
        inputs=tuple(tensor for tensor in bundle.manifest.policy.inputs if tensor.name != "belief"),
    )
    manifest = replace(bundle.manifest, files={}, policy=graph, search=True)
    with pytest.raises(UsageError, match="search without a belief"):
        write_bundle(tmp_path / "c", manifest, encoder=None, policy=bundle.policy, golden=bundle.golden)


def test_several_checkpoints_become_one_bundle_of_their_mean(tmp_path, capsys):
    paths = [str(fresh.save_adatracker(tmp_path / f"{seed}.pt", seed=seed)) for seed in (1, 2)]
    assert main(["export-onnx", *paths, "--out", str(tmp_path / "mean")]) == 0
    assert "difference" in capsys.readouterr().out
    assert load_bundle(tmp_path / "mean").manifest.training.startswith("The mean of 2 runs' weights:")


def test_name_rate_and_licence_can_be_given(checkpoint, tmp_path):
    manifest = export_checkpoint(checkpoint, tmp_path / "b", name="mine", rate_hz=20, licence="MIT")
    assert (manifest.name, manifest.rate_hz, manifest.licence) == ("mine", 20.0, "MIT")
    assert manifest.interface == "streaming"


def test_a_folder_in_use_is_left_alone_unless_forced(checkpoint, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(UsageError, match="--force"):
        export_checkpoint(checkpoint, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
    export_checkpoint(checkpoint, tmp_path, force=True)
    OnnxPolicy(load_bundle(tmp_path))
    assert (tmp_path / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize(
    ("settings", "reason"),
    [({"rate_hz": 0.0}, "rate_hz: 0.0 is out of range"), ({"rate_hz": float("nan")}, "finite")],
)
def test_a_wrong_setting_is_refused_and_nothing_written(checkpoint, tmp_path, settings, reason):
    with pytest.raises(UsageError, match=reason):
        export_checkpoint(checkpoint, tmp_path / "b", **settings)
    assert not (tmp_path / "b").exists()


def test_offline_evt_takes_no_encoder_interface(tmp_path):
    path = fresh.save_offline_evt(tmp_path / "evt.pth")
    with pytest.raises(UsageError, match="has no context encoder"):
        export_checkpoint(path, tmp_path / "b", interface="streaming")
    assert not (tmp_path / "b").exists()


def evt_by_hand(weights, masks):
    """Compute Offline EVT from its published weights, with the LSTM written out."""

    def convolved(x, layer, padding):
        name = f"CNN_LSTM.CNN_Simple.{layer}"
        x = functional.conv2d(x, weights[f"{name}.weight"], weights[f"{name}.bias"], padding=padding)
        return functional.max_pool2d(x, 2).relu()

    def linear(x, name, suffix=""):
        return weights[f"{name}weight{suffix}"] @ x + weights[f"{name}bias{suffix}"]

    h, c, actions = torch.zeros(64), torch.zeros(64), []
    for mask in torch.from_numpy(masks):
        x = convolved(convolved(mask[None], "conv1", 2), "conv2", 1)
        x = convolved(convolved(x, "conv3", 1), "conv4", 1).flatten()
        i, f, g, o = (linear(x, "CNN_LSTM.lstm.", "_ih_l0") + linear(h, "CNN_LSTM.lstm.", "_hh_l0")).chunk(4)
        c = f.sigmoid() * c + i.sigmoid() * g.tanh()
        h = o.sigmoid() * c.tanh()
        x = linear(linear(h, "actor_local.fc1.").relu(), "actor_local.fc2.").relu()
        actions.append(linear(x, "actor_local.mu.").tanh())
    return torch.stack(actions).numpy()


def exported_evt_answers_by_hand(path, out):
    manifest = export_checkpoint(path, out)
    assert manifest.interface == "none"
    masks = walking_masks(OFFLINE_EVT.mask, TICKS, seed=2)
    actions, _ = answers(OnnxPolicy(load_bundle(out)), masks)
    wanted = evt_by_hand(torch.load(path, map_location="cpu", weights_only=True), masks)
    np.testing.assert_allclose(actions, wanted, atol=1e-4)
    return actions


def test_offline_evt_answers_as_written_out_by_hand(tmp_path):
    exported_evt_answers_by_hand(fresh.save_offline_evt(tmp_path / "evt.pth"), tmp_path / "bundle")


@pytest.mark.skipif(not PUBLISHED.exists(), reason="the published checkpoint is not here: it has no licence")
def test_the_published_checkpoint_answers_as_written_out_by_hand(tmp_path):
    actions = exported_evt_answers_by_hand(PUBLISHED, tmp_path)
    assert np.ptp(actions, axis=0).min() > 0.1


def tool(folder, *arguments):
    command = [sys.executable, ROOT / "tools" / "export_onnx.py", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@EXHAUSTIVE
def test_the_tool_exports_and_sums_up(checkpoint, tmp_path):
    done = tool(tmp_path, checkpoint, "--out", "b", "--interface", "window")
    assert (done.returncode, done.stderr) == (0, "")
    assert "window, history 5, context 4" in done.stdout
    assert "+forward, -yaw" in done.stdout
    OnnxPolicy(load_bundle(tmp_path / "b"))


@pytest.mark.parametrize("arguments", [("missing.pt", "--out", "b"), ("missing.pt",)])
def test_the_tool_refuses_in_one_line_with_status_2(tmp_path, arguments):
    done = tool(tmp_path, *arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert not any(tmp_path.iterdir())
