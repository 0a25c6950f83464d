"""The layout for Foxglove asks for nothing that is not told, and shows every panel that it describes."""

from __future__ import annotations

import json
import re

import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.trial.channels import channels
from adatracker_deploy.trial.live_layout import live_layout

LAYOUT = json.loads(live_layout())
PANELS = LAYOUT["configById"]
CHANNELS = {channel.topic: channel for channel in channels()}


def topics(panel):
    """A panel's topics, with the schema that each must have."""
    image = panel.get("imageMode")
    if image:
        yield image["imageTopic"], "foxglove.CompressedImage"
        for topic in image.get("annotations", {}):
            yield topic, "foxglove.ImageAnnotations"
    if "topicToRender" in panel:
        yield panel["topicToRender"], "foxglove.Log"


def paths():
    return [(name, path["value"]) for name, panel in PANELS.items() for path in panel.get("paths", ())]


def placed(layout):
    return [layout] if isinstance(layout, str) else placed(layout["first"]) + placed(layout["second"])


def test_every_panel_has_its_place():
    assert sorted(placed(LAYOUT["layout"])) == sorted(PANELS)


@pytest.mark.parametrize("name", PANELS)
def test_a_panels_topics_are_told_with_the_schemas_that_it_draws(name):
    wanted = list(topics(PANELS[name]))
    assert wanted or PANELS[name].get("paths")
    assert [(topic, CHANNELS[topic].schema_name) for topic, _ in wanted] == wanted


@pytest.mark.parametrize(("panel", "path"), paths())
def test_a_path_leads_to_one_value_that_the_panel_can_draw(panel, path):
    topic, *fields = path.split(".")
    assert CHANNELS[topic].encoding == "json"
    found = json.loads(CHANNELS[topic].schema)
    for name, index in (re.fullmatch(r"(\w+)(\[\d+\])?", field).groups() for field in fields):
        found = found["properties"][name]
        if index:
            found = found["items"]
    assert found["type"] == ("string" if panel.startswith("StateTransitions!") else "number")


def test_the_command_writes_it(capsys):
    assert main(["layout"]) == 0
    assert json.loads(capsys.readouterr().out) == LAYOUT
