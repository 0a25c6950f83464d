"""A trial as a rosbag2 bag: read by rosbags, by Foxglove's reader of ROS 2 messages, and by ROS 2 itself."""

from __future__ import annotations

import math
import sys

import cv2
import numpy as np
import pytest
import yaml
from mcap.reader import make_reader

from adatracker_deploy.cli import main
from adatracker_deploy.core.camera_info import CameraInfo
from adatracker_deploy.core.geometry import Quaternion
from adatracker_deploy.core.messages import Box, Twist
from adatracker_deploy.trial.reader import read_trial
from tests.trial.records import START_NS, TICK_NS, a_frame, a_log, a_step, a_trial, an_observation

pytest.importorskip("rosbags", reason="needs the extra 'rosbag2'")

from adatracker_deploy.report.rosbag2.messages import STORE

TOPICS = {
    "/adatracker/battery": "sensor_msgs/msg/BatteryState",
    "/adatracker/box": "visualization_msgs/msg/ImageMarker",
    "/adatracker/camera/compressed": "sensor_msgs/msg/CompressedImage",
    "/adatracker/command/asked": "geometry_msgs/msg/TwistStamped",
    "/adatracker/command/sent": "geometry_msgs/msg/TwistStamped",
    "/adatracker/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/adatracker/log": "rcl_interfaces/msg/Log",
    "/adatracker/mask/compressed": "sensor_msgs/msg/CompressedImage",
    "/adatracker/odom": "nav_msgs/msg/Odometry",
    "/adatracker/velocity": "geometry_msgs/msg/TwistStamped",
}
LENS = CameraInfo(
    width_px=160,
    height_px=120,
    fx=96.5,
    fy=97.25,
    cx=80.5,
    cy=59.5,
    coefficients=(-0.08, 0.01, 0.0, 0.0, 0.0),
)


def exported(trial, out):
    assert main(["export", str(trial), "--rosbag2", str(out)]) == 0
    return bag_of(out)


def bag_of(out):
    """Every message by its topic, as (time, message), by rosbags' own reader."""
    from rosbags.rosbag2 import Reader

    found = {}
    with Reader(out) as reader:
        for connection, time_ns, data in reader.messages():
            message = STORE.deserialize_cdr(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((time_ns, message))
    return found


def logged_ns(trial):
    """The times in the log, by the MCAP library: {topic: [ns]}."""
    found = {}
    with (trial / "trial.mcap").open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(log_time_order=False):
            found.setdefault(channel.topic, []).append(message.log_time)
    return found


def stamp_ns(message):
    stamp = message.header.stamp
    return stamp.sec * 10**9 + stamp.nanosec


def twist_of(message):
    linear, angular = message.twist.linear, message.twist.angular
    return Twist(linear.x, linear.y, linear.z, angular.z)


@pytest.fixture
def trial(tmp_path):
    """Five ticks with their pictures, of which one lost the target, one was not answered; and an event."""
    with a_log(tmp_path, steps=4) as log:
        for number in range(5):
            changes = {2: {"box": None, "target": "lost"}, 3: {"sent": None, "gate": (), "stale": True}}
            step = a_step(number, command=Twist(0.1 * number, 0.0, 0.3, -0.7), **changes.get(number, {}))
            log.step(step, a_frame(number), an_observation(number))
        log.event("warning", "the wind is up", START_NS + TICK_NS)
        log.close({"outcome": "completed"})
    return log.folder


def test_the_bag_has_every_message_of_the_log_at_its_time(trial, tmp_path, capsys):
    bag, logged = exported(trial, tmp_path / "bag"), logged_ns(trial)
    out, err = capsys.readouterr()
    assert (out, err) == (f"{tmp_path / 'bag'}\n", f"{sum(map(len, bag.values()))} messages\n")
    assert sorted(path.name for path in (tmp_path / "bag").iterdir()) == ["bag.mcap", "metadata.yaml"]
    times = {topic: [time_ns for time_ns, _ in messages] for topic, messages in bag.items()}
    for name in ("camera", "mask"):
        assert times[f"/adatracker/{name}/compressed"] == logged[f"/{name}"]
    for name in ("battery", "command/asked", "diagnostics", "odom", "velocity"):
        assert times[f"/adatracker/{name}"] == logged["/step"], name
    assert times["/adatracker/command/sent"] == [
        time for place, time in enumerate(logged["/step"]) if place != 3
    ]
    assert times["/adatracker/box"] == logged["/box"]
    assert times["/adatracker/log"] == sorted(logged["/log"])


def test_its_numbers_are_the_logs(trial, tmp_path):
    bag, steps = exported(trial, tmp_path / "bag"), read_trial(trial).steps
    for topic, wanted in {
        "command/asked": [step.command for step in steps],
        "command/sent": [step.sent for step in steps if step.sent is not None],
        "velocity": [step.velocity for step in steps],
    }.items():
        assert [twist_of(message) for _, message in bag[f"/adatracker/{topic}"]] == wanted
    for (time_ns, odometry), step in zip(bag["/adatracker/odom"], steps, strict=True):
        angles = step.pose.roll, step.pose.pitch, step.pose.yaw
        place, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
        assert (place.x, place.y, place.z) == (step.pose.x, step.pose.y, step.pose.z)
        assert (turn.w, turn.x, turn.y, turn.z) == Quaternion.of(*angles)
        assert twist_of(odometry.twist) == step.velocity
        assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
        assert stamp_ns(odometry) == time_ns - round(step.state_age_s * 1e9)
    assert [message.percentage for _, message in bag["/adatracker/battery"]] == [np.float32(0.8)] * 5
    (_, event), *_ = bag["/adatracker/log"]
    assert (event.level, event.msg) == (30, "the wind is up")


def test_pictures_and_masks_are_passed_on_byte_by_byte_with_the_time_of_their_capture(trial, tmp_path):
    bag, read = exported(trial, tmp_path / "bag"), read_trial(trial)
    frames = list(read.frames())
    for (time_ns, image), step, frame in zip(
        bag["/adatracker/camera/compressed"], read.steps, frames, strict=True
    ):
        assert (image.format, bytes(image.data)) == ("jpeg", frame.jpeg)
        assert time_ns - stamp_ns(image) == step.t_ns - (START_NS + step.frame_seq * TICK_NS)
    for (_, image), frame in zip(bag["/adatracker/mask/compressed"], frames, strict=True):
        assert image.format == "png"
        assert np.array_equal(cv2.imdecode(image.data, cv2.IMREAD_UNCHANGED).shape[:2], frame.mask.shape)


def test_the_box_is_drawn_in_the_pictures_pixels_and_taken_away_while_it_is_lost(trial, tmp_path):
    bag, steps = exported(trial, tmp_path / "bag"), read_trial(trial).steps
    boxes = [message for _, message in bag["/adatracker/box"]]
    assert [(box.action, len(box.points)) for box in boxes] == [(0, 4), (0, 4), (1, 0), (0, 4), (0, 4)]
    left, top = boxes[0].points[0].x / 160, boxes[0].points[0].y / 120
    right, bottom = boxes[0].points[2].x / 160, boxes[0].points[2].y / 120
    found = Box((left + right) / 2, (top + bottom) / 2, right - left, bottom - top)
    assert found.iou(steps[0].box) == pytest.approx(1.0, abs=1e-12)


def test_diagnostics_say_why_the_gate_changed_a_command_and_what_the_loop_took(trial, tmp_path):
    bag, steps = exported(trial, tmp_path / "bag"), read_trial(trial).steps
    for (_, found), step in zip(bag["/adatracker/diagnostics"], steps, strict=True):
        by_name = {status.name: status for status in found.status}
        assert by_name["adatracker: gate"].message == ", ".join(step.gate)
        assert by_name["adatracker: gate"].level == (1 if step.gate else 0)
        values = {name: {pair.key: pair.value for pair in status.values} for name, status in by_name.items()}
        assert float(values["adatracker: loop"]["lateness_ms"]) == step.latency.lateness_ms
        assert float(values["adatracker: target"]["confidence"]) == step.confidence
        if step.box is not None:
            box = Box(*(float(values["adatracker: target"][name]) for name in ("cx", "cy", "w", "h")))
            assert box == step.box
    words = [status.message for _, found in bag["/adatracker/diagnostics"] for status in found.status[1:2]]
    assert words == ["seen", "seen", "lost", "stale", "seen"]


def test_what_the_robot_did_not_tell_is_not_made_up(tmp_path):
    steps = [
        a_step(0, pose=None, battery=None, state_age_s=math.inf),
        a_step(1, velocity=None),
        a_step(2, velocity=None, pose=None, battery=None),
    ]
    bag = exported(a_trial(tmp_path, steps), tmp_path / "bag")
    assert [len(bag[f"/adatracker/{name}"]) for name in ("velocity", "odom", "battery")] == [1, 1, 1]
    (_, odometry), *_ = bag["/adatracker/odom"]
    assert math.isnan(odometry.twist.twist.linear.x)
    (time_ns, velocity), *_ = bag["/adatracker/velocity"]
    assert stamp_ns(velocity) == time_ns
    assert "/adatracker/camera_info" not in bag


def test_the_lens_that_the_camera_told_goes_with_every_picture(tmp_path):
    from dataclasses import asdict

    config = {"camera_info": asdict(LENS), "profile": {"camera": {"fov_deg": None}}}
    bag = exported(a_trial(tmp_path, [a_step(0), a_step(1)], config=config), tmp_path / "bag")
    pictures, infos = bag["/adatracker/camera/compressed"], bag["/adatracker/camera_info"]
    assert [stamp_ns(info) for _, info in infos] == [stamp_ns(picture) for _, picture in pictures]
    (_, info), *_ = infos
    assert (info.width, info.height, info.distortion_model) == (160, 120, "plumb_bob")
    assert info.k.tolist() == [96.5, 0, 80.5, 0, 97.25, 59.5, 0, 0, 1]
    assert info.p.reshape(3, 4)[:, :3].tolist() == info.k.reshape(3, 3).tolist()
    assert info.d.tolist() == [-0.08, 0.01, 0, 0, 0]


def test_a_profiles_field_of_view_comes_before_what_the_camera_told(tmp_path):
    from dataclasses import asdict

    config = {"camera_info": asdict(LENS), "profile": {"camera": {"fov_deg": 90}}}
    bag = exported(a_trial(tmp_path, [a_step(0)], config=config), tmp_path / "bag")
    ((_, info),) = bag["/adatracker/camera_info"]
    assert info.k.tolist() == [pytest.approx(80), 0, 79.5, 0, pytest.approx(80), 59.5, 0, 0, 1]


def test_metadata_tells_what_ros2_bag_asks_of_it(trial, tmp_path):
    bag = exported(trial, tmp_path / "bag")
    told = yaml.safe_load((tmp_path / "bag/metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (told["version"], told["storage_identifier"]) == (8, "mcap")
    assert told["relative_file_paths"] == ["bag.mcap"]
    times = [time_ns for messages in bag.values() for time_ns, _ in messages]
    assert told["message_count"] == len(times)
    assert told["starting_time"]["nanoseconds_since_epoch"] == min(times)
    assert told["duration"]["nanoseconds"] == max(times) - min(times)
    topics = {one["topic_metadata"]["name"]: one for one in told["topics_with_message_count"]}
    assert {name: one["topic_metadata"]["type"] for name, one in topics.items()} == TOPICS
    assert all(one["topic_metadata"]["serialization_format"] == "cdr" for one in topics.values())
    assert {name: one["message_count"] for name, one in topics.items()} == {
        name: len(messages) for name, messages in bag.items()
    }


def test_foxgloves_reader_reads_it_by_the_definitions_that_it_carries(trial, tmp_path):
    pytest.importorskip("mcap_ros2", reason="needs mcap-ros2-support")
    from mcap_ros2.decoder import DecoderFactory

    bag = exported(trial, tmp_path / "bag")
    found = {}
    with (tmp_path / "bag/bag.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for schema, channel, record, message in reader.iter_decoded_messages():
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            found.setdefault(channel.topic, []).append((record.log_time, message))
    assert {topic: len(messages) for topic, messages in found.items()} == {
        topic: len(messages) for topic, messages in bag.items()
    }
    for topic in ("/adatracker/command/sent", "/adatracker/velocity"):
        assert [(time_ns, twist_of(message)) for time_ns, message in found[topic]] == [
            (time_ns, twist_of(message)) for time_ns, message in bag[topic]
        ]


def test_ros_2_itself_reads_every_message_that_it_has_a_type_for(trial, tmp_path):
    pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'adatracker-deploy[ros2]'")
    from importlib import import_module

    from rclpy.serialization import deserialize_message

    bag, read = exported(trial, tmp_path / "bag"), set()
    with (tmp_path / "bag/bag.mcap").open("rb") as stream:
        for schema, channel, record in make_reader(stream).iter_messages():
            package, _, name = schema.name.split("/")
            try:
                kind = getattr(import_module(f"{package}.msg"), name)
            except ImportError:
                continue
            message = deserialize_message(record.data, kind)
            read.add(schema.name)
            if name == "TwistStamped":
                place = [time for time, _ in bag[channel.topic]].index(record.log_time)
                assert twist_of(message) == twist_of(bag[channel.topic][place][1])
                assert stamp_ns(message) == stamp_ns(bag[channel.topic][place][1])
            if name == "Odometry":
                assert message.pose.pose.position.x == 1.0
            if name == "CompressedImage":
                assert cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_COLOR) is not None
    assert read >= {TOPICS[f"/adatracker/{name}"] for name in ("velocity", "odom", "battery", "log")}


@pytest.mark.parametrize(("where", "told"), [("bag", "is there already"), ("no/bag", "cannot be written")])
def test_a_folder_that_cannot_be_is_refused_in_a_line(trial, tmp_path, capsys, where, told):
    (tmp_path / "bag").mkdir()
    before = sorted(tmp_path.rglob("*"))
    assert main(["export", str(trial), "--rosbag2", str(tmp_path / where)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line
    assert sorted(tmp_path.rglob("*")) == before


def test_it_takes_one_trial_that_has_ticks(trial, tmp_path, capsys):
    assert main(["export", str(trial), str(trial), "--rosbag2", str(tmp_path / "bag")]) == 2
    assert "takes one trial, got 2" in capsys.readouterr().err
    empty = a_trial(tmp_path, [])
    assert main(["export", str(empty), "--rosbag2", str(tmp_path / "bag")]) == 2
    assert "no ticks in it" in capsys.readouterr().err


def test_without_rosbags_it_says_what_to_install(trial, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    assert main(["export", str(trial), "--rosbag2", str(tmp_path / "bag")]) == 2
    assert "pip install 'adatracker-deploy[rosbag2]'" in capsys.readouterr().err
