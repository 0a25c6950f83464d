"""A recipe that is quick to collect."""

from __future__ import annotations

from adatracker_deploy.learning.data.recipe import Recipe, parse_recipe

MAPPING = {
    "description": "small",
    "steps": 200,
    "episode_steps": 40,
    "scenes": {"simple_room": 1},
    "kinds": {"differential": 1, "quadruped": 1},
    "height_m": {"low": 0.3, "high": 2.0},
    "pitch_deg": {"one_of": [0, 10]},
    "fov_deg": {"low": 80, "high": 100},
    "forward_m_s": {"low": 1.0, "high": 2.0},
    "backward_share": {"one_of": [0.5]},
    "target_share": {"low": 0.4, "high": 0.8},
    "yaw_rate_deg_s": {"one_of": [120]},
    "lag_s": {"low": 0.0, "high": 0.3},
    "delay_steps": {"one_of": [0, 1, 2]},
    "paths": {"random_walk": 1, "u_turns": 1},
    "obstacles": 0.5,
    "others": {"one_of": [0, 1]},
    "crossing": {"one_of": [0, 1]},
    "noise": {"none": 1, "field": 1},
}


def recipe(**changed: object) -> Recipe:
    return parse_recipe(MAPPING | changed, where="tiny", name="tiny")
