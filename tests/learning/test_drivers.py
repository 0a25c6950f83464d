"""Bodies that obey late may have a driver of their own: in torch, in the bundle, and back."""

from __future__ import annotations

import re

import numpy as np
import onnxruntime as ort
import pytest
import torch

from adatracker_deploy.cli import main
from adatracker_deploy.learning.bundle_weights import networks_of
from adatracker_deploy.learning.checkpoint import one_driver, save_checkpoint
from adatracker_deploy.policy import belief, response
from adatracker_deploy.policy.bundle import load_bundle
from tests.learning import fresh

pytestmark = pytest.mark.slow


def of_two_drivers(tmp_path, late=None):
    """Return two drivers, which have the same eyes and encoder, and the command that joins them."""
    config = fresh.VARIANTS["response"]
    usual, other = fresh.adatracker(1, config), fresh.adatracker(2, late or config)
    if late is None:
        other.policy.backbone.load_state_dict(usual.policy.backbone.state_dict())
    for name, each in (("usual", usual), ("late", other)):
        save_checkpoint(tmp_path / f"{name}.pt", usual.encoder, each.policy, fresh.META)
    paths = str(tmp_path / "usual.pt"), "--late", str(tmp_path / "late.pt"), "--out", str(tmp_path / "two")
    return usual.policy, other.policy, ["export-onnx", *paths]


@pytest.mark.parametrize(("late_s", "share"), [(0.4, 0.0), (1.3, 0.0), (1.425, 0.5), (1.55, 1.0), (1.6, 1.0)])
def test_a_body_that_obeys_late_has_a_driver_of_its_own(tmp_path, late_s, share):
    usual, late, command = of_two_drivers(tmp_path)
    assert main(command) == 0
    bundle = load_bundle(tmp_path / "two")
    session = ort.InferenceSession(bundle.policy)
    size, told = fresh.CONFIG.hidden, fresh.CONFIG.context
    state = {name: np.zeros((1, 1, 2 * size), np.float32) for name in ("h", "c")}
    states = [None, None]
    rng = np.random.default_rng(3)
    for mask in bundle.golden["mask"][:4]:
        z = rng.uniform(-1, 1, (1, told + response.SIZE)).astype(np.float32)
        z[0, told + response.COLUMNS.index("delay")] = min(late_s, 0.6) / 0.6
        z[0, told + response.COLUMNS.index("lag")] = max(late_s - 0.6, 0.0)
        rest = {"last_action": rng.uniform(-1, 1, (1, 2)), "belief": rng.uniform(-1, 1, (1, belief.SIZE))}
        given = {"mask": mask[None], "z": z} | {name: part.astype(np.float32) for name, part in rest.items()}
        got, state["h"], state["c"] = session.run(["action", "h_next", "c_next"], given | state)
        wanted = []
        for which, driver in enumerate((usual, late)):
            parts = [torch.from_numpy(part)[:, None] for part in given.values()]
            with torch.no_grad():
                mean, _, states[which] = driver(parts[0], parts[1], states[which], *parts[2:])
            wanted.append(mean[0].numpy())
        np.testing.assert_allclose(got, np.tanh((1 - share) * wanted[0] + share * wanted[1]), atol=1e-5)


@pytest.mark.parametrize("late", [False, True])
def test_training_begins_with_one_driver_of_two(tmp_path, late):
    *drivers, command = of_two_drivers(tmp_path)
    assert main(command) == 0
    found = networks_of(load_bundle(tmp_path / "two")).policy
    assert found.config.second_driver
    alone = one_driver(found, late=late)
    assert alone.config == drivers[late].config
    for name, value in drivers[late].state_dict().items():
        assert "log_std" in name or torch.equal(alone.state_dict()[name], value)


@pytest.mark.parametrize(
    ("late", "reason"),
    [
        (fresh.VARIANTS["response"], r"late\.pt: its policy\.backbone\.patches\.weight is another's"),
        (fresh.VARIANTS["belief"], r"late\.pt: its networks are not those of the usual driver"),
        (fresh.VARIANTS["second driver"], r"late\.pt: its networks are not those of the usual driver"),
    ],
)
def test_a_second_driver_who_sees_otherwise_is_refused(tmp_path, late, reason, capsys):
    _, _, command = of_two_drivers(tmp_path, late)
    assert main(command) == 2
    assert re.search(reason, capsys.readouterr().err)
    assert not (tmp_path / "two").exists()


def test_offline_evt_has_no_second_driver(tmp_path, capsys):
    path = str(fresh.save_offline_evt(tmp_path / "evt.pt"))
    assert main(["export-onnx", path, "--late", path, "--out", str(tmp_path / "two")]) == 2
    assert "only AdaTracker's networks can have a driver" in capsys.readouterr().err
