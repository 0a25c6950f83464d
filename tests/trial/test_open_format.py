"""The file opens without this toolkit: by the plain mcap library, with the schemas that it carries itself."""

from __future__ import annotations

import json
import time

import cv2
import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader

from tests.trial.records import START_NS, TICK_NS, a_step, a_trial

STEPS = 4


@pytest.fixture(scope="module")
def messages(tmp_path_factory):
    """(schema, log time, decoded message) by topic."""
    folder = a_trial(tmp_path_factory.mktemp("trials"), [a_step(step) for step in range(STEPS)])
    found = {}
    with (folder / "trial.mcap").open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            decoded = json.loads(message.data) if schema.encoding == "jsonschema" else decode(schema, message)
            found.setdefault(channel.topic, []).append((schema, message.log_time, decoded))
    return found


def decode(schema, message):
    """Decode protobuf by the descriptors in the file."""
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
    return kind.FromString(message.data)


def test_the_channels_have_the_viewers_own_schemas(messages):
    assert {topic: found[0][0].name for topic, found in messages.items()} == {
        "/step": "adatracker.Step",
        "/command": "adatracker.Command",
        "/camera": "foxglove.CompressedImage",
        "/mask": "foxglove.CompressedImage",
        "/box": "foxglove.ImageAnnotations",
        "/pose": "foxglove.PoseInFrame",
    }


def test_every_tick_is_in_every_channel(messages):
    assert {topic: len(found) for topic, found in messages.items()} == dict.fromkeys(messages, STEPS)


def test_times_are_the_walls_and_a_tick_apart(messages):
    times = [log_time for _, log_time, _ in messages["/step"]]
    assert np.diff(times).tolist() == [TICK_NS] * (STEPS - 1)
    assert abs(times[0] - time.time_ns()) < 600e9


def test_images_are_plain_jpeg_and_png(messages):
    for topic, encoding in (("/camera", "jpeg"), ("/mask", "png")):
        image = messages[topic][0][2]
        assert image.format == encoding
        assert cv2.imdecode(np.frombuffer(image.data, np.uint8), cv2.IMREAD_COLOR).shape == (120, 160, 3)


def test_the_box_is_drawn_in_pixels_at_the_images_time(messages):
    (outline,) = messages["/box"][1][2].points
    corners = np.array([(point.x, point.y) for point in outline.points])
    assert corners == pytest.approx(np.array([(64, 36), (96, 36), (96, 84), (64, 84)]))
    captured = messages["/camera"][1][2].timestamp
    assert outline.timestamp.ToNanoseconds() == captured.ToNanoseconds()


def test_the_pose_is_a_unit_quaternion_that_turns_as_the_pose_does(messages):
    q = messages["/pose"][0][2].pose.orientation
    forward = (
        1 - 2 * (q.y**2 + q.z**2),
        2 * (q.x * q.y + q.w * q.z),
        2 * (q.x * q.z - q.w * q.y),
    )
    assert q.w**2 + q.x**2 + q.y**2 + q.z**2 == pytest.approx(1)
    assert forward == pytest.approx(a_step(0).pose.rotation()[:, 0])


def test_commands_are_what_was_asked_and_what_was_sent(messages):
    command = messages["/command"][0][2]
    assert (command["asked"]["vx"], command["sent"]["vx"]) == (1.0, 0.8)


def test_steps_keep_the_runs_clock(messages):
    assert [step["t_ns"] for _, _, step in messages["/step"]] == [
        START_NS + i * TICK_NS for i in range(STEPS)
    ]
