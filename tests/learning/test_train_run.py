"""A run ends in the same weights however often it was interrupted, and refuses to go on as another one."""

from __future__ import annotations

import copy
import csv
import os
import signal
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.bundle_weights import networks_of
from adatracker_deploy.learning.checkpoint import load_checkpoint, one_driver, save_checkpoint
from adatracker_deploy.learning.data.collect import collect
from adatracker_deploy.learning.data.recipe import load_recipe
from adatracker_deploy.learning.export import export_checkpoint
from adatracker_deploy.learning.rollout import rollout
from adatracker_deploy.learning.train import visitor
from adatracker_deploy.learning.train.run import train
from adatracker_deploy.learning.train.settings import TrainSettings
from adatracker_deploy.learning.train.snapshot import read_snapshot, write_snapshot
from adatracker_deploy.policy.catalogue import find_bundle
from tests.tiers import EXHAUSTIVE

pytestmark = pytest.mark.slow

TINY = TrainSettings(recipe="paper", updates=6, rounds=1, round_steps=150, batch=2, length=20)
METHODS = {
    "dagger": TINY,
    "awr": replace(TINY, method="awr", critic_updates=20, front="pooled", belief=True, response=True),
    "td3": replace(
        TINY, method="td3", init="adatracker", belief=True, response=True, critic_updates=1, round_steps=150
    ),
    "cql_sac": replace(TINY, method="cql_sac"),
}

WITH_PARTS = {
    "dagger": METHODS["dagger"],
    "awr": replace(METHODS["awr"], response=False),
    "cql_sac": METHODS["cql_sac"],
}
"""Those that train all networks."""
VARIANTS = ("no-identification", "no-dynamics", "no-consistency", "no-encoder", "no-lstm", "no-last-action")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    collect(load_recipe("paper"), folder, steps=400, seed=3)
    return [folder]


def trained(settings, data, out, *, resume=False, interrupt_after=None):
    """Run to the end, or press Ctrl-C after some update."""

    def tell(update, _loss):
        if update == interrupt_after:
            os.kill(os.getpid(), signal.SIGINT)

    return train(settings, data, out, resume=resume, say=print, tell=tell)


@pytest.fixture(scope="module", params=METHODS)
def method(request):
    return METHODS[request.param]


@pytest.fixture(scope="module")
def whole(method, data, tmp_path_factory):
    out = tmp_path_factory.mktemp("run") / "whole"
    trained(method, data, out)
    return out


def weights(out):
    return torch.load(out / "policy.pt", weights_only=True)["state_dict"]


def same(one, other):
    return all(torch.equal(one[key], other[key]) for key in one | other)


@pytest.mark.parametrize("update", [1, 3, 5])
def test_interrupted_and_resumed_it_ends_in_the_same_weights_to_the_bit(
    method, data, whole, tmp_path, update
):
    with pytest.raises(KeyboardInterrupt):
        trained(method, data, tmp_path / "cut", interrupt_after=update)
    trained(method, data, tmp_path / "cut", resume=True)
    assert same(weights(whole), weights(tmp_path / "cut"))


def test_another_seed_ends_in_other_weights(method, data, whole, tmp_path):
    trained(replace(method, seed=1), data, tmp_path / "other")
    assert not same(weights(whole), weights(tmp_path / "other"))


def test_every_weight_that_acts_has_learned(method, data, whole, tmp_path):
    begun = tmp_path / "begun"
    with pytest.raises(KeyboardInterrupt):
        trained(method, data, begun, interrupt_after=1)
    # The deployed action does not depend on log_std; cloning leaves it. td3 leaves what it looks through.
    left = ("log_std", "backbone", "encoder") if method.method == "td3" else ("log_std",)
    still = {key for key, weight in weights(begun).items() if torch.equal(weight, weights(whole)[key])}
    assert all(any(part in key for part in left) for key in still)


def test_a_run_begins_with_the_weights_of_another(method, data, whole, tmp_path):
    settings = replace(method, init=str(whole), rate=1e-7, updates=1, rounds=0)
    trained(settings, data, tmp_path / "on")
    before, after = weights(whole), weights(tmp_path / "on")
    assert all(torch.allclose(before[key], after[key], atol=1e-6) for key in before)
    with pytest.raises(UsageError, match="its networks differ"):
        trained(replace(settings, variants=("no-lstm",)), data, tmp_path / "other")
    with pytest.raises(UsageError, match=r"holds no training\.pt"):
        trained(replace(settings, init=str(tmp_path / "none")), data, tmp_path / "other")
    assert not (tmp_path / "other").exists()


def begun_with(bundle, data, out, **told):
    """Train on from a bundle so little that it answers as before; assert that it does."""
    settings = replace(TINY, init=bundle, rate=1e-7, updates=1, rounds=0, belief=True, **told)
    golden = find_bundle(bundle).golden
    answers = rollout(load_checkpoint(trained(settings, data, out)), golden["mask"])
    for name in ("action", "z"):
        begun = answers[name][:, : golden[name].shape[1]]
        assert np.abs(begun - golden[name]).max() < 1e-4


def test_a_run_begins_with_the_weights_of_the_shipped_bundle(data, tmp_path):
    """Its answers feed back, so one update moves them further than its weights; these are compared."""
    settings = replace(TINY, init="adatracker", rate=1e-7, updates=1, rounds=0, belief=True, response=True)
    begun = load_checkpoint(trained(settings, data, tmp_path / "on"))
    shipped = networks_of(find_bundle("adatracker"))
    for ours, theirs in ((begun.policy, one_driver(shipped.policy)), (begun.encoder, shipped.encoder)):
        weights = ours.state_dict()
        for name, weight in theirs.state_dict().items():
            if ".log_std." not in name:  # not in a bundle
                torch.testing.assert_close(weights[name], weight, rtol=1e-6, atol=2e-7)


@pytest.mark.parametrize("late", [False, True])
def test_td3_goes_on_from_the_driver_that_it_makes(data, tmp_path, late):
    shipped = networks_of(find_bundle("adatracker"))
    usual, other = one_driver(shipped.policy), copy.deepcopy(one_driver(shipped.policy))
    with torch.no_grad():
        for weight in [*other.memory.parameters(), *other.actor.parameters()]:
            weight.mul_(0.99)  # the export writes equal weights once
    for name, policy in (("usual", usual), ("late", other)):
        save_checkpoint(tmp_path / f"{name}.pt", shipped.encoder, policy, shipped.meta)
    export_checkpoint(tmp_path / "usual.pt", tmp_path / "two", late=[tmp_path / "late.pt"])
    settings = replace(
        METHODS["td3"], init=str(tmp_path / "two"), late=late, critic_updates=2, updates=1, rounds=0
    )
    begun = load_checkpoint(trained(settings, data, tmp_path / "on")).policy
    torch.testing.assert_close(begun.actor.mean.bias, (usual, other)[late].actor.mean.bias)


def test_told_a_belief_a_bundle_answers_as_before_until_it_has_learned_what_that_means(data, tmp_path):
    export_checkpoint(trained(TINY, data, tmp_path / "before"), tmp_path / "bundle")
    begun_with(str(tmp_path / "bundle"), data, tmp_path / "on")
    begun_with(str(tmp_path / "bundle"), data, tmp_path / "more", response=True)


@pytest.mark.parametrize("told", [False, True])
def test_a_run_does_not_begin_with_a_bundle_of_other_networks(data, tmp_path, told):
    export_checkpoint(trained(replace(TINY, belief=told), data, tmp_path / "before"), tmp_path / "bundle")
    settings = replace(TINY, init=str(tmp_path / "bundle"), variants=("no-last-action",), belief=True)
    with pytest.raises(UsageError, match="its networks differ: last_action True, not False"):
        trained(settings, data, tmp_path / "on")


def test_a_run_does_not_begin_with_a_bundle_that_sees_or_drives_otherwise(data, tmp_path):
    checkpoint = networks_of(find_bundle("adatracker"))
    turned = replace(checkpoint.meta, action=tuple(reversed(checkpoint.meta.action)))
    save_checkpoint(tmp_path / "turned.pt", checkpoint.encoder, checkpoint.policy, turned)
    export_checkpoint(tmp_path / "turned.pt", tmp_path / "turned")
    with pytest.raises(UsageError, match="its masks, its action or its rate are not those"):
        trained(replace(TINY, init=str(tmp_path / "turned"), belief=True), data, tmp_path / "on")


def test_without_an_lstm_a_run_that_is_told_a_belief_begins_with_none_that_is_not(data, tmp_path):
    settings = replace(TINY, variants=("no-lstm",), updates=1, rounds=0)
    trained(settings, data, tmp_path / "before")
    with pytest.raises(UsageError, match="its networks differ: belief False, not True"):
        trained(replace(settings, init=str(tmp_path / "before"), belief=True), data, tmp_path / "on")


def test_an_interrupted_visit_begins_again_and_changes_nothing(data, tmp_path, monkeypatch):
    settings = METHODS["dagger"]
    trained(settings, data, tmp_path / "whole")
    collect_visited = visitor.collect_visited

    def cut_short(recipe, policy, *, steps, **rest):
        collect_visited(recipe, policy, steps=steps // 2, **rest)
        raise KeyboardInterrupt

    monkeypatch.setattr(visitor, "collect_visited", cut_short)
    with pytest.raises(KeyboardInterrupt):
        trained(settings, data, tmp_path / "cut")
    monkeypatch.undo()
    assert not any((tmp_path / "cut").glob("visited-1/part-*"))
    trained(settings, data, tmp_path / "cut", resume=True)
    assert same(weights(tmp_path / "whole"), weights(tmp_path / "cut"))


def test_resuming_a_finished_run_leaves_its_policy_as_it_is(method, data, whole):
    before = (whole / "policy.pt").read_bytes()
    trained(method, data, whole, resume=True)
    assert (whole / "policy.pt").read_bytes() == before


def test_its_policy_is_a_checkpoint_that_says_how_it_was_made(method, whole):
    checkpoint = load_checkpoint(whole / "policy.pt")
    assert checkpoint.policy.config == method.config()
    told = (", pooled front" if method.front == "pooled" else "") + (
        ", belief, response" if method.belief else ""
    )
    assert (
        f"{method.method}, recipe paper{told}\n6 updates of 2 x 20 steps, seed 0" in checkpoint.meta.training
    )


def test_curves_hold_each_scalar_once_an_update_and_drop_what_was_lost(data, tmp_path, monkeypatch):
    monkeypatch.setattr("adatracker_deploy.learning.train.curves.EVERY", 1)
    with pytest.raises(KeyboardInterrupt):
        trained(TINY, data, tmp_path / "cut", interrupt_after=2)
    with (tmp_path / "cut" / "curves.csv").open("a") as file:
        file.write("5,loss,9\n")  # of updates that were not saved
    trained(TINY, data, tmp_path / "cut", resume=True)
    with (tmp_path / "cut" / "curves.csv").open() as file:
        rows = [(int(row["update"]), row["name"]) for row in csv.DictReader(file)]
    losses = [update for update, name in rows if name == "loss"]
    assert losses == list(range(1, TINY.updates + 1))
    assert len(rows) == len(set(rows))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"updates": 7}, "updates 6, not 7"),
        ({"seed": 2}, "seed 0, not 2"),
        ({"variants": ("no-encoder",)}, r"variants \(\), not \('no-encoder',\)"),
        ({"method": "cql_sac"}, "method 'dagger', not 'cql_sac'"),
    ],
)
def test_a_run_does_not_go_on_with_other_settings(data, tmp_path_factory, change, reason):
    out = tmp_path_factory.getbasetemp() / "settings"
    if not out.exists():
        trained(TINY, data, out)
    with pytest.raises(UsageError, match=reason):
        trained(replace(TINY, **change), data, out, resume=True)


def test_a_run_does_not_go_on_with_other_data(method, data, whole):
    with pytest.raises(UsageError, match="began with 400 steps of data, not 800"):
        trained(method, [*data, *data], whole, resume=True)


def test_a_run_whose_networks_were_others_does_not_go_on(method, data, whole, tmp_path):
    old = read_snapshot(whole)
    part = "critics" if "critics" in old.learner else "agent"
    name, *_ = (name for name, value in old.learner[part].items() if value.ndim == 2)
    old.learner[part][name] = old.learner[part][name][:, 1:]
    write_snapshot(tmp_path, old)
    with pytest.raises(
        UsageError, match=f"begun by another version, whose {method.method} had other"
    ) as refused:
        trained(method, data, tmp_path, resume=True)
    assert "\n" not in str(refused.value)


def test_a_device_without_memory_is_no_other_version(method, data, whole, monkeypatch):
    def full(self, state):
        raise torch.OutOfMemoryError("out of memory")

    monkeypatch.setattr("torch.optim.Adam.load_state_dict", full)
    with pytest.raises(torch.OutOfMemoryError):
        trained(method, data, whole, resume=True)


def test_a_run_is_not_overwritten_and_nothing_is_not_resumed(method, data, whole, tmp_path):
    with pytest.raises(UsageError, match="holds a run; go on with it by --resume"):
        trained(method, data, whole)
    with pytest.raises(UsageError, match="to resume"):
        trained(method, data, tmp_path, resume=True)


@pytest.mark.parametrize("content", [b"", b"junk", b"PK\x03\x04 cut short"])
def test_a_damaged_snapshot_is_refused_in_one_line(data, tmp_path, content):
    (tmp_path / "training.pt").write_bytes(content)
    with pytest.raises(UsageError, match=r"training\.pt: ") as refused:
        trained(TINY, data, tmp_path, resume=True)
    assert "\n" not in str(refused.value)


def test_a_policy_is_no_snapshot(method, data, whole, tmp_path):
    (tmp_path / "training.pt").write_bytes((whole / "policy.pt").read_bytes())
    with pytest.raises(UsageError, match="not a snapshot that this version reads"):
        trained(method, data, tmp_path, resume=True)


def test_no_data_and_no_such_device_are_refused(data, tmp_path):
    with pytest.raises(UsageError, match="no shards and no trials in"):
        trained(TINY, [tmp_path], tmp_path / "out")
    with pytest.raises(UsageError, match="device 'warp' cannot be used"):
        train(TINY, data, tmp_path / "out", device="warp", say=print, tell=print)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("variant", "method"),
    [
        pytest.param(variant, method, marks=() if (which + other) % len(WITH_PARTS) == 0 else EXHAUSTIVE)
        for which, variant in enumerate(VARIANTS)
        for other, method in enumerate(WITH_PARTS)
    ],
)
def test_every_variant_trains_and_differs_from_the_whole(data, tmp_path, variant, method):
    settings = replace(WITH_PARTS[method], variants=(variant,), updates=2, rounds=0)
    whole = trained(replace(settings, variants=()), data, tmp_path / "whole")
    checkpoint, other = load_checkpoint(trained(settings, data, tmp_path / "a")), load_checkpoint(whole)
    assert (checkpoint.encoder is None) is (variant == "no-encoder")
    if checkpoint.policy.config == other.policy.config:
        assert not torch.equal(checkpoint.encoder.to_context.weight, other.encoder.to_context.weight)


def test_in_bfloat16_it_ends_near_where_it_ends_in_full_precision(method, data, whole, tmp_path):
    settings = replace(method, bfloat16=True)
    try:
        with torch.autocast("cpu", torch.bfloat16):
            nn.LSTM(2, 2)(torch.zeros(1, 1, 2))
    except RuntimeError:  # a processor without AVX-512
        with pytest.raises(UsageError, match="--bfloat16: device 'cpu' cannot; leave it out"):
            trained(settings, data, tmp_path / "short")
        assert not (tmp_path / "short").exists()
        return
    trained(settings, data, tmp_path / "short")
    full, short = weights(whole), weights(tmp_path / "short")
    assert not same(full, short)
    # A few steps of 1e-3 at most: an update is as large whatever the gradient's digits.
    assert all((full[key] - short[key]).abs().max() < 0.02 for key in full)
