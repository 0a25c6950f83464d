"""A checkpoint comes back as it was saved; anything else is refused in one line, and no code in it runs."""

from __future__ import annotations

import os
from dataclasses import replace

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.checkpoint import AdaTracker, OfflineEvt, load_checkpoint, load_mean
from tests.learning import fresh


class Payload:
    """A pickle that makes a folder when it is read."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def saved(path, change):
    """Save the small checkpoint after `change` was made to its mapping."""
    content = torch.load(fresh.save_adatracker(path), weights_only=True)
    change(content)
    torch.save(content, path)
    return path


def refusal(path):
    with pytest.raises(UsageError) as refused:
        load_checkpoint(path)
    message = str(refused.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    return message


def test_what_was_saved_comes_back(tmp_path):
    loaded = load_checkpoint(fresh.save_adatracker(tmp_path / "a.pt", seed=3))
    assert isinstance(loaded, AdaTracker)
    assert loaded.meta == fresh.META
    assert loaded.encoder.config == loaded.policy.config == fresh.CONFIG
    wanted = fresh.adatracker(seed=3)
    for network, original in ((loaded.encoder, wanted.encoder), (loaded.policy, wanted.policy)):
        assert not network.training
        for key, weight in original.state_dict().items():
            assert torch.equal(network.state_dict()[key], weight), key


@pytest.mark.parametrize("variant", fresh.VARIANTS)
def test_a_variant_comes_back_with_its_parts(tmp_path, variant):
    config = fresh.VARIANTS[variant]
    loaded = load_checkpoint(fresh.save_adatracker(tmp_path / "a.pt", config=config))
    assert loaded.policy.config == config
    assert (loaded.encoder is None) is (config.context == 0)


def test_a_mean_has_the_mean_of_every_weight_and_says_whose(tmp_path):
    paths = [fresh.save_adatracker(tmp_path / f"{seed}.pt", seed=seed) for seed in (1, 2, 6)]
    mean = load_mean(paths)
    for part in ("encoder", "policy"):
        alone = [getattr(fresh.adatracker(seed=seed), part).state_dict() for seed in (1, 2, 6)]
        for key, weight in getattr(mean, part).state_dict().items():
            torch.testing.assert_close(weight, (alone[0][key] + alone[1][key] + alone[2][key]) / 3)
    assert mean.meta.training.startswith("The mean of 3 runs' weights:\n")
    assert fresh.META.training in mean.meta.training
    assert load_mean(paths[:1]).meta == fresh.META


def test_what_has_no_mean_is_refused(tmp_path):
    one = fresh.save_adatracker(tmp_path / "one.pt")
    wider = fresh.save_adatracker(tmp_path / "wider.pt", config=replace(fresh.CONFIG, hidden=9))
    slower = fresh.save_adatracker(tmp_path / "slower.pt", meta=replace(fresh.META, rate_hz=5.0))
    evt = fresh.save_offline_evt(tmp_path / "evt.pth")
    for other in (wider, slower):
        with pytest.raises(UsageError, match=rf"{other}: its networks, masks, .* are not {one}'s"):
            load_mean([one, other])
    with pytest.raises(UsageError, match=rf"{evt}: only AdaTracker checkpoints have a mean"):
        load_mean([one, evt])


def test_an_encoder_without_a_history_is_refused(tmp_path):
    path = saved(tmp_path / "half.pt", lambda c: c["config"].update(history=0))
    with pytest.raises(UsageError, match="history 0 and context 4"):
        load_checkpoint(path)


def test_offline_evt_is_known_by_its_keys_and_its_critics_are_left(tmp_path):
    loaded = load_checkpoint(fresh.save_offline_evt(tmp_path / "evt.pth"))
    assert isinstance(loaded, OfflineEvt)
    assert [entry.axis for entry in loaded.meta.action] == ["yaw", "forward"]
    assert [entry.sign for entry in loaded.meta.action] == [-1, 1]


def test_a_pickle_with_code_is_refused_and_the_code_does_not_run(tmp_path):
    made = tmp_path / "made by the pickle"
    path = tmp_path / "evil.pt"
    torch.save({"format": "adatracker", "config": Payload(made)}, path)
    assert "more than tensors" in refusal(path)
    assert not made.exists()


def test_a_missing_file_a_folder_and_an_empty_file_are_refused(tmp_path):
    assert "no such checkpoint" in refusal(tmp_path / "missing.pt")
    assert "no such checkpoint" in refusal(tmp_path)
    (tmp_path / "empty.pt").touch()
    assert "not a checkpoint" in refusal(tmp_path / "empty.pt")


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(data=st.binary(min_size=1, max_size=200))
def test_any_bytes_are_refused_in_one_line(tmp_path, data):
    (tmp_path / "noise.pt").write_bytes(data)
    refusal(tmp_path / "noise.pt")


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=30)
@given(share=st.floats(0, 0.99))
def test_a_download_cut_short_is_refused_in_one_line(tmp_path, share):
    path = tmp_path / "whole.pt"
    data = path.read_bytes() if path.exists() else fresh.save_adatracker(path).read_bytes()
    (tmp_path / "cut.pt").write_bytes(data[: int(share * len(data))])
    refusal(tmp_path / "cut.pt")


@pytest.mark.parametrize("content", [{"weight": torch.zeros(1)}, [1, 2], torch.zeros(3), {1: 2}])
def test_an_unknown_kind_is_refused(tmp_path, content):
    torch.save(content, tmp_path / "other.pt")
    assert "neither an AdaTracker checkpoint" in refusal(tmp_path / "other.pt")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda c: c.pop("meta"), "meta is missing"),
        (lambda c: c["meta"].pop("licence"), "missing key 'licence'"),
        (lambda c: c["meta"].update(rate_hz=0.0), "rate_hz: 0.0 is out of range"),
        (lambda c: c["config"].update(width=3), "unknown key 'width'"),
        (lambda c: c["config"].update(size=48), "meta and config differ"),
        (lambda c: c["config"].update(hidden=9), "weights do not fit"),
        (lambda c: c["state_dict"].pop("encoder.to_context.bias"), "weights do not fit"),
        (lambda c: c["state_dict"]["policy.actor.mean.bias"].fill_(torch.nan), "not finite"),
    ],
)
def test_an_inconsistent_checkpoint_is_refused_with_the_reason(tmp_path, change, reason):
    assert reason in refusal(saved(tmp_path / "changed.pt", change))


def test_meta_that_differs_from_the_networks_is_refused(tmp_path):
    meta = replace(fresh.META, action=fresh.META.action[:1])
    assert "meta and config differ" in refusal(fresh.save_adatracker(tmp_path / "a.pt", meta=meta))
