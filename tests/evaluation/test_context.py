"""The study of z finds what was put in, and nothing where nothing was."""

from __future__ import annotations

import numpy as np
import pytest

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.evaluation.context import Recorded, explained, plane, settled_tick, settling
from adatracker_deploy.evaluation.context_study import study_context
from adatracker_deploy.evaluation.context_view import context_picture, context_table
from adatracker_deploy.evaluation.play import play_all
from adatracker_deploy.learning.change import Change
from adatracker_deploy.learning.embodiment import Embodiment
from adatracker_deploy.learning.seeds import FIRST_EVALUATION
from tests.policy import tiny

TICKS, Z = 60, 5
FLAT = {"log yaw_rate_rad_s", "pitch_deg", "fov_deg"}


def bodies(count=40, seed=0, noise=0.05, told_from=0):
    """Bodies whose z tells height and log limit along two directions, from a tick on; lag is not in it."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(2, Z))
    made = []
    for _ in range(count):
        body = Embodiment(
            height_m=rng.uniform(0.3, 3.0),
            forward_m_s=float(np.exp(rng.uniform(-1, 1))),
            lag_s=rng.uniform(0, 0.5),
            delay_s=rng.uniform(0, 0.3),
        )
        told = np.array([body.height_m, np.log(body.forward_m_s)]) @ directions + 10.0
        contexts = np.tile(told, (TICKS, 1))
        contexts[:told_from] = 10.0
        made.append(Recorded(body, (contexts + noise * rng.normal(size=contexts.shape)).astype(np.float32)))
    return made


def test_r2_is_near_1_for_what_z_tells_and_near_0_for_the_rest():
    scores = explained(bodies(200))
    assert scores["height_m"] > 0.95
    assert scores["log forward_m_s"] > 0.95
    assert abs(scores["lag_s"]) < 0.2
    assert abs(scores["delay_s"]) < 0.2
    assert {name for name, score in scores.items() if score is None} == FLAT


def test_what_z_tells_is_compared_with_what_the_body_is_by_then():
    rng = np.random.default_rng(2)
    made = []
    for _ in range(40):
        change = Change(at_step=40, forward=float(rng.uniform(0.2, 1.0)))
        body = Embodiment(forward_m_s=float(rng.uniform(0.5, 2.0)))
        limits = [body.forward_m_s] * 40 + [body.forward_m_s * change.forward] * 20
        made.append(Recorded(body, np.log(limits)[:, None].astype(np.float32), change))
    assert explained(made)["log forward_m_s"] > 0.999
    assert explained([Recorded(one.embodiment, one.contexts) for one in made])["log forward_m_s"] < 0.95


def test_r2_is_of_bodies_that_were_not_fitted():
    """As many free numbers as bodies fit anything: held-out bodies are not fooled."""
    rng = np.random.default_rng(1)
    noise = [
        Recorded(Embodiment(height_m=rng.uniform(0.3, 3)), rng.normal(size=(21, 20)).astype(np.float32))
        for _ in range(20)
    ]
    assert explained(noise)["height_m"] < 0.2


def test_a_z_that_tells_late_settles_when_it_tells():
    assert settled_tick(settling(bodies(told_from=12))) == 12
    assert settled_tick(settling(bodies())) == 0


def test_a_large_constant_part_does_not_look_settled():
    early = settling(bodies(told_from=12))[:12]
    assert abs(early.mean()) < 0.6
    assert settling(bodies(told_from=12))[12:].min() > 0.9


def test_a_z_of_noise_alone_has_no_direction_to_settle_to():
    rng = np.random.default_rng(0)
    noise = [Recorded(Embodiment(), rng.normal(size=(TICKS, Z)).astype(np.float32)) for _ in range(10)]
    assert settling(noise)[30:].mean() < 0.5


def test_bodies_that_ended_early_count_while_they_lasted():
    short = [Recorded(body.embodiment, body.contexts[: 25 + 5 * (n % 3)]) for n, body in enumerate(bodies())]
    curve = settling(short)
    assert curve.shape == (35,)
    assert np.isfinite(curve).all()


def test_the_plane_is_that_of_the_largest_spread():
    rng = np.random.default_rng(0)
    flat = rng.normal(size=(50, 2)) * (3.0, 1.0)
    axes, _ = np.linalg.qr(rng.normal(size=(6, 6)))
    points, shares = plane(flat @ axes[:2] + 4.0)
    assert shares.sum() == pytest.approx(1.0)
    assert shares[0] > shares[1]
    distances = np.linalg.norm(points[:, None] - points, axis=-1)
    np.testing.assert_allclose(distances, np.linalg.norm(flat[:, None] - flat, axis=-1), atol=1e-9)


def test_too_few_bodies_are_refused():
    with pytest.raises(ValueError, match="four bodies"):
        explained(bodies(3))
    with pytest.raises(ValueError, match="no plane"):
        plane(np.zeros((1, 4)))
    with pytest.raises(UsageError, match="at least 8"):
        study_context("pid", play_all, bodies=7)


def test_a_bundle_is_studied_from_end_to_end(tmp_path):
    tiny.Parts().write(tmp_path)
    met = []

    def playing(episodes):
        met.extend(episodes)
        return play_all(episodes)

    study = study_context(str(tmp_path), playing, bodies=8, steps=30, swap=True)
    assert len(study.bodies) == 8
    assert min(episode.spec.seed for episode in met) >= FIRST_EVALUATION
    frozen, swapped = met[8:16], met[16:]
    for own, other in ((met[:8], frozen), (met[:8], swapped)):
        assert [e.spec for e in own] == [e.spec for e in other]
    np.testing.assert_array_equal(
        [e.imposed for e in swapped], np.roll([e.imposed for e in frozen], 1, axis=0)
    )
    record = study.record()
    assert record["bodies"] == 8
    assert len(record["cosines"]) == max(len(body.contexts) for body in study.bodies)
    assert record["swap"]["swapped"]["low"] <= record["swap"]["swapped"]["value"]
    context_picture("tiny", study).savefig(tmp_path / "z.png")
    assert (tmp_path / "z.png").read_bytes().startswith(b"\x89PNG")
    assert context_table("tiny", study) is not None
