"""Collections repeat whatever the workers, go on after an interruption, and never mix."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.data import collect as module
from adatracker_deploy.learning.data import shard as shards
from adatracker_deploy.learning.data.collect import collect, perturbed_episode
from adatracker_deploy.learning.data.perturbation import LEVELS, Perturbation
from adatracker_deploy.learning.data.shard import read_shard, unpack_masks
from adatracker_deploy.learning.seeds import TRAINING
from adatracker_deploy.learning.tracking import Tracking
from tests.learning.data import tiny
from tests.tiers import EXHAUSTIVE

SHARD = 80


@pytest.fixture(autouse=True)
def small_shards(monkeypatch):
    monkeypatch.setattr(module, "SHARD_STEPS", SHARD)


def contents(folder: Path) -> dict[str, bytes]:
    """Everything but the archives' time stamps: the arrays' bytes."""
    return {
        f"{path.name}/{name}": array.tobytes()
        for path in sorted(folder.glob("shard-*.npz"))
        for name, array in np.load(path).items()
    }


def test_a_collection_has_exactly_the_steps_that_were_asked_for_and_its_episodes_add_up(tmp_path):
    told = []
    collect(tiny.recipe(), tmp_path, seed=3, progress=lambda done, steps: told.append((done, steps)))
    made = [read_shard(path) for path in sorted(tmp_path.glob("*.npz"))]
    assert [len(shard.steps) for shard in made] == [80, 80, 40]
    assert told == [(0, 200), (80, 200), (160, 200), (200, 200)]
    for shard in made:
        assert sum(episode.steps for episode in shard.episodes) == len(shard.steps)
        assert all(episode.spec.seed in TRAINING for episode in shard.episodes)


def test_two_workers_leave_the_same_files_as_one(tmp_path):
    collect(tiny.recipe(), tmp_path / "one", seed=1)
    collect(tiny.recipe(), tmp_path / "two", seed=1, workers=2)
    assert contents(tmp_path / "one") == contents(tmp_path / "two")


@EXHAUSTIVE
def test_a_ray_cluster_leaves_the_same_files(tmp_path):
    collect(tiny.recipe(), tmp_path / "one", seed=1)
    collect(tiny.recipe(), tmp_path / "ray", seed=1, ray="local")
    assert contents(tmp_path / "one") == contents(tmp_path / "ray")


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("127.0.0.1:1", "no cluster answers"),
        ("nowhere", "expected HOST:PORT"),
        ("auto", "no cluster answers"),
    ],
)
def test_a_cluster_that_is_not_there_is_one_line(tmp_path, capsys, address, says):
    command = ["collect", "--recipe", "paper", "--out", str(tmp_path), "--steps", "10", "--ray", address]
    assert main(command) == 2
    assert says in capsys.readouterr().err.splitlines()[-1]


def test_an_interrupted_collection_goes_on_and_keeps_what_was_finished(tmp_path):
    class Interrupted(Exception):
        pass

    def interrupt(done, steps):
        if done >= 80:
            raise Interrupted

    with pytest.raises(Interrupted):
        collect(tiny.recipe(), tmp_path / "cut", seed=2, progress=interrupt)
    first = tmp_path / "cut" / "shard-00000.npz"
    written_ns = first.stat().st_mtime_ns
    assert not (tmp_path / "cut" / "shard-00001.npz").exists()
    collect(tiny.recipe(), tmp_path / "cut", seed=2)
    collect(tiny.recipe(), tmp_path / "whole", seed=2)
    assert first.stat().st_mtime_ns == written_ns
    assert contents(tmp_path / "cut") == contents(tmp_path / "whole")


def test_a_larger_collection_goes_on_from_a_smaller_one(tmp_path):
    collect(tiny.recipe(), tmp_path / "grown", steps=100)
    collect(tiny.recipe(), tmp_path / "grown", steps=200)
    collect(tiny.recipe(), tmp_path / "at once", steps=200)
    assert contents(tmp_path / "grown") == contents(tmp_path / "at once")


@pytest.mark.parametrize("changed", [{"seed": 1}, {"recipe": tiny.recipe(obstacles=0.0)}])
def test_a_folder_with_another_collection_is_refused(tmp_path, changed):
    collect(tiny.recipe(), tmp_path, steps=10)
    with pytest.raises(UsageError, match="holds another collection"):
        collect(**({"recipe": tiny.recipe()} | changed), out_dir=tmp_path, steps=10)


def test_a_collection_goes_on_that_was_begun_before_a_recipe_could_have_a_key(tmp_path):
    collect(tiny.recipe(), tmp_path, steps=100)
    about = tmp_path / "collection.json"
    content = json.loads(about.read_text(encoding="utf-8"))
    for key in ("expert", "perturbed", "change"):
        del content["recipe"][key]
    about.write_text(json.dumps(content), encoding="utf-8")
    collect(tiny.recipe(), tmp_path, steps=200)
    with pytest.raises(UsageError, match="holds another collection"):
        collect(tiny.recipe(expert={"lead": 0.0}), tmp_path, steps=200)


def test_an_experts_gains_are_those_of_the_recipe():
    _, eager = perturbed_episode(tiny.recipe(), seed=5, steps=30)
    _, calm = perturbed_episode(tiny.recipe(expert={"settling_s": 1.0}), seed=5, steps=30)
    assert np.abs(calm.experts).mean() < np.abs(eager.experts).mean()


def test_a_truncated_shard_is_noticed_when_a_collection_goes_on(tmp_path):
    collect(tiny.recipe(), tmp_path, steps=100)
    path = tmp_path / "shard-00000.npz"
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(UsageError, match=r"shard-00000\.npz: is damaged or cut short; delete it"):
        collect(tiny.recipe(), tmp_path, steps=100)


def test_an_episodes_first_mask_is_at_its_start_and_its_rewards_follow_from_its_actions():
    header, steps = perturbed_episode(tiny.recipe(), seed=5, steps=30)
    again = Tracking(header.spec, header.spec.task_settings(30))
    assert np.array_equal(unpack_masks(steps.masks)[0], again.begin().mask)
    for t in range(30):
        tick = again.step(steps.actions[t])
        assert steps.rewards[t] == np.float32(tick.reward)
        assert steps.visible[t] == tick.visible
        if t < 29:
            assert np.array_equal(unpack_masks(steps.masks[t + 1]), tick.observation.mask)
            assert steps.dropped[t + 1] == tick.dropped


def test_every_level_of_perturbation_is_drawn_and_strays_further_than_the_one_below():
    levels = {Perturbation.drawn(seed)._level for seed in range(100)}
    assert levels == set(LEVELS)
    strays = []
    for level in LEVELS:
        perturb = Perturbation(np.random.default_rng(0), level)
        made = np.array([perturb(np.zeros(2, np.float32)) for _ in range(4000)])
        assert np.abs(made).max() <= 1.0
        strays.append(np.abs(made).mean())
    assert strays[0] == 0.0
    assert strays == sorted(strays)
    assert strays[-1] > 0.3


def test_in_bouts_the_expert_is_perturbed_for_its_share_of_the_time_and_by_itself_for_the_rest():
    perturb = Perturbation(np.random.default_rng(0), 1.0, share=0.4)
    clean = np.array([perturb(np.full(2, 0.5, np.float32)) for _ in range(20_000)]) == 0.5
    calm = clean.all(axis=1)
    assert calm.mean() == pytest.approx(0.6, abs=0.05)
    lengths = np.diff(np.flatnonzero(np.diff(calm)))[::2]
    assert lengths.mean() > 5  # a second and more, and not a step here and there


def test_the_label_is_the_clean_action_and_the_perturbed_one_was_executed(tmp_path):
    collect(tiny.recipe(), tmp_path, steps=160)
    steps = shards.Steps.joined([read_shard(path).steps for path in tmp_path.glob("*.npz")])
    differs = (steps.actions != steps.experts).any(axis=1)
    assert differs.any()
    assert not steps.done.all()


def test_the_command_collects_and_tells_so_in_json(tmp_path, capsys):
    out = tmp_path / "data"
    words = ["collect", "--recipe", "paper", "--steps", "60", "--workers", "1", "--out", str(out), "--json"]
    assert main(words) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["recipe"], said["steps"], said["out"]) == ("paper", 60, str(out))
    assert len(read_shard(out / "shard-00000.npz").steps) == 60


@pytest.mark.parametrize("wrong", [["--steps", "0"], ["--workers", "0"], ["--recipe", "soup"]])
def test_the_command_refuses_what_makes_no_sense(tmp_path, wrong, capsys):
    assert main(["collect", "--out", str(tmp_path / "data"), *wrong]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_mask_that_is_wider_than_high_is_kept_in_the_middle_of_a_square():
    _, steps = perturbed_episode(tiny.recipe(aspect={"one_of": [0.5]}), seed=5, steps=10)
    masks = unpack_masks(steps.masks)
    assert masks.shape == (10, 64, 64)
    assert not masks[:, :16].any()
    assert not masks[:, -16:].any()
    assert masks[:, 16:-16].any()


def test_a_recipe_s_other_draws_do_not_depend_on_its_pictures():
    square, wide = tiny.recipe().draw(7), tiny.recipe(aspect={"one_of": [0.75]}).draw(7)
    body = dataclasses.replace(wide.embodiment, aspect=1.0, pitch_deg=square.embodiment.pitch_deg)
    assert dataclasses.replace(wide, embodiment=body) == square
