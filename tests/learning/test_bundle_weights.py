"""A bundle gives back the networks that were exported, or is refused."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.bundle_weights import networks_of
from adatracker_deploy.learning.export import export_checkpoint
from adatracker_deploy.learning.networks import AdaTrackerConfig
from adatracker_deploy.policy.bundle import load_bundle
from tests.learning import fresh
from tests.tiers import sampled

pytestmark = pytest.mark.slow


def exported(path, out, **options):
    export_checkpoint(path, out, **options)
    return load_bundle(out)


@pytest.mark.parametrize(
    ("variant", "interface"),
    sampled(
        (
            ("belief", "streaming"),
            ("belief", "window"),
            ("no encoder, last action", None),
            ("pooled", "streaming"),
        ),
        everyday=(("belief", "window"), ("no encoder, last action", None)),
    ),
)
def test_it_gives_back_the_weights_that_were_exported(tmp_path, variant, interface):
    config = fresh.VARIANTS[variant]
    path = fresh.save_adatracker(tmp_path / "fresh.pt", config=config)
    found, wanted = (
        networks_of(exported(path, tmp_path / "bundle", interface=interface)),
        fresh.adatracker(0, config),
    )
    unknown = {} if config.history else {"encoder_hidden": AdaTrackerConfig().encoder_hidden}
    assert found.policy.config == replace(config, **unknown)
    assert found.meta == fresh.META
    for one, other in ((found.policy, wanted.policy), (found.encoder, wanted.encoder)):
        if other is None:
            assert one is None
            continue
        had = {name: value for name, value in other.state_dict().items() if "log_std" not in name}
        assert all(torch.equal(one.state_dict()[name], value) for name, value in had.items())


def test_networks_that_answer_otherwise_than_the_golden_vectors_are_refused(tmp_path):
    bundle = exported(fresh.save_adatracker(tmp_path / "fresh.pt"), tmp_path / "bundle")
    wrong = bundle.golden | {"z": bundle.golden["z"] + 0.01}
    with pytest.raises(UsageError, match=r"bundle: its networks are not AdaTracker's"):
        networks_of(replace(bundle, golden=wrong))


def test_networks_of_another_kind_are_refused(tmp_path):
    bundle = exported(fresh.save_offline_evt(tmp_path / "evt.pt"), tmp_path / "evt")
    with pytest.raises(UsageError, match=r"evt: its networks are not AdaTracker's"):
        networks_of(bundle)
