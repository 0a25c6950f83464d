"""The simulated PX4 sends and answers MAVLink messages as PX4 does, and hostile bytes move nothing."""

import dataclasses
import math
import struct

import pytest
from flight import STOCK, Flight, velocity
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink
from pymavlink.dialects.v20 import development

from adatracker_drone.protocol.dialect import CurrentMode, Event
from adatracker_drone.protocol.events import number_of
from adatracker_drone.protocol.packets import CURRENT_MODE, HEARD, split
from adatracker_drone.protocol.px4 import Mode, Result
from adatracker_drone.sim.autopilot import _HANDLERS, Autopilot
from adatracker_drone.sim.motion import Motion
from adatracker_drone.sim.parameters import PARAMETERS, Kind, from_wire, to_wire
from adatracker_drone.sim.services import SERVICES


def carried(name, value):
    """Return a PARAM_SET as a ground station makes it: byte-wise."""
    kind = PARAMETERS[name].kind
    return mavlink.MAVLink_param_set_message(1, 1, name.encode(), to_wire(kind, value), kind)


# Telling


def test_the_streams_come_at_px4s_rates():
    flight = Flight().run(10.0)
    rates = {
        "ATTITUDE": 100,
        "GLOBAL_POSITION_INT": 50,
        "LOCAL_POSITION_NED": 30,
        "ODOMETRY": 30,
        "TIMESYNC": 10,
        "VFR_HUD": 10,
        "GPS_RAW_INT": 8,
        "SYS_STATUS": 5,
        "EXTENDED_SYS_STATE": 5,
        "HEARTBEAT": 1,
        "CURRENT_MODE": 0.5,
        "HOME_POSITION": 0.5,
    }
    for kind, hz in rates.items():
        assert len(flight.of(kind)) == pytest.approx(10 * hz, abs=1), kind


def test_everything_that_a_client_waits_for_is_told_at_once():
    flight = Flight().run(0.02)
    told = {message.get_type() for _, message in flight.said}
    assert {"HEARTBEAT", "HOME_POSITION", "SYS_STATUS", "EXTENDED_SYS_STATE", "GPS_RAW_INT"} <= told


def test_a_heartbeat_says_px4_quadrotor_mode_and_arming():
    flight = Flight().run(1.1)
    first = flight.of("HEARTBEAT")[0]
    assert (first.autopilot, first.type) == (mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_TYPE_QUADROTOR)
    assert first.custom_mode == Mode.HOLD.custom_mode == 0x03040000
    assert not first.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    flight.arm()
    flight.run(1.0)
    assert flight.of("HEARTBEAT")[-1].base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED


def test_disarmed_and_not_armable_it_does_not_say_standby():
    flight = Flight().run(3.0)
    states = [message.system_status for message in flight.of("HEARTBEAT")]
    assert states[0] == mavlink.MAV_STATE_UNINIT == 0
    assert states[-1] == mavlink.MAV_STATE_STANDBY
    flight.arm()
    flight.run(1.0)
    assert flight.of("HEARTBEAT")[-1].system_status == mavlink.MAV_STATE_ACTIVE


def test_a_change_of_mode_is_told_no_sooner_than_the_next_heartbeat():
    flight = Flight().offboard(velocity())
    told = [message.custom_mode for message in flight.of("HEARTBEAT")]
    assert flight.mode is Mode.OFFBOARD
    assert told[-1] == Mode.HOLD.custom_mode
    flight.run(1.0, stream=velocity())
    assert flight.of("HEARTBEAT")[-1].custom_mode == Mode.OFFBOARD.custom_mode


def test_the_rate_of_heartbeats_cannot_be_changed():
    flight = Flight()
    assert flight.order(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, 200_000) is Result.FAILED
    flight.run(10.0)
    assert len(flight.of("HEARTBEAT")) == pytest.approx(10, abs=1)


def test_at_20_hz_the_mode_is_told_twice_a_second_and_at_once_when_it_changes():
    flight = Flight().offboard(velocity())
    flight.order(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, CURRENT_MODE, 50_000)
    before = len(flight.of("CURRENT_MODE"))
    flight.run(10.0, stream=velocity())
    assert len(flight.of("CURRENT_MODE")) - before == pytest.approx(20, abs=1)
    flight.switch(Mode.POSCTL)
    flight.run(0.06)
    told = flight.of("CURRENT_MODE")[-1]
    assert told.custom_mode == told.intended_custom_mode == Mode.POSCTL.custom_mode


def test_a_fail_safes_mode_is_told_beside_the_one_that_was_asked_for():
    flight = Flight().set("COM_OBL_RC_ACT", 4).offboard(velocity())
    flight.order(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, CURRENT_MODE, 50_000)
    flight.run(1.2)
    told = flight.of("CURRENT_MODE")[-1]
    assert told.custom_mode == Mode.LAND.custom_mode
    assert told.intended_custom_mode == Mode.OFFBOARD.custom_mode


def test_an_older_px4_does_not_tell_its_mode_so():
    flight = Flight(dataclasses.replace(STOCK, tells_current_mode=False))
    assert flight.order(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, CURRENT_MODE, 50_000) is Result.DENIED
    assert not flight.run(3.0).of("CURRENT_MODE")


def test_asked_for_its_mode_it_answers_by_heartbeat_always_and_by_current_mode_when_there_is_news():
    flight = Flight().hover()
    assert flight.order(mavlink.MAV_CMD_REQUEST_MESSAGE, CURRENT_MODE) is Result.ACCEPTED
    assert flight.order(mavlink.MAV_CMD_REQUEST_MESSAGE, CURRENT_MODE) is Result.DENIED
    before = len(flight.of("HEARTBEAT"))
    assert flight.order(mavlink.MAV_CMD_REQUEST_MESSAGE, 0) is Result.ACCEPTED
    assert len(flight.of("HEARTBEAT")) == before + 1


def test_a_mode_switch_is_acknowledged_twice():
    flight = Flight().run(0.1)
    flight.switch(Mode.POSCTL)
    assert [ack.command for ack in flight.of("COMMAND_ACK")] == [mavlink.MAV_CMD_DO_SET_MODE] * 2


def test_its_own_messages_are_whole_by_the_adapters_own_measure():
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    for message, payload in (
        (CurrentMode(6 << 16, 4 << 16), struct.pack("<II", 6 << 16, 4 << 16)),
        (Event(number_of("check_modes_offboard_signal"), 5, 1, 2), b""),
    ):
        (packet,) = split(bytes(message.pack(link)))
        assert packet.is_whole
        assert payload[:7] in packet.data
    known = development.mavlink_map[CURRENT_MODE]
    assert HEARD[CURRENT_MODE] == known.crc_extra


def test_the_armable_bit_appears_when_arming_would_be_granted():
    flight = Flight().run(2.0)
    bits = [bool(m.onboard_control_sensors_health & 0x10000000) for m in flight.of("SYS_STATUS")]
    assert bits == sorted(bits)
    assert not bits[0]
    assert bits[-1]


def test_local_and_global_position_tell_the_same_place():
    flight = Flight().offboard(velocity(forward=2.0)).run(4.0, stream=velocity(forward=2.0))
    local, world = flight.of("LOCAL_POSITION_NED")[-1], flight.of("GLOBAL_POSITION_INT")[-1]
    home = flight.of("HOME_POSITION")[-1]
    east_m = (
        math.radians((world.lon - home.longitude) / 1e7)
        * 6_371_000
        * math.cos(math.radians(home.latitude / 1e7))
    )
    assert east_m == pytest.approx(local.y, abs=0.3)
    assert world.relative_alt / 1000 == pytest.approx(-local.z, abs=0.1)
    assert flight.body.pose.x == pytest.approx(local.y, abs=0.3)


def test_the_battery_empties_in_flight_only():
    flight = Flight().run(5.0)
    assert flight.of("SYS_STATUS")[-1].battery_remaining == 100
    flight.hover().run(15.0)
    assert flight.of("SYS_STATUS")[-1].battery_remaining < 100


# Answering


def test_an_unknown_command_is_answered_unsupported():
    assert Flight().order(mavlink.MAV_CMD_DO_PARACHUTE) is Result.UNSUPPORTED


@pytest.mark.parametrize(
    "number", [mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, mavlink.MAVLINK_MSG_ID_HOME_POSITION]
)
def test_a_message_that_is_requested_comes(number):
    flight = Flight().run(0.5)
    before = len(flight.said)
    assert flight.order(mavlink.MAV_CMD_REQUEST_MESSAGE, number) is Result.ACCEPTED
    assert number in [message.get_msgId() for _, message in flight.said[before:]]


def test_the_older_request_for_capabilities_is_answered():
    flight = Flight()
    assert flight.order(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1) is Result.ACCEPTED
    (version,) = flight.of("AUTOPILOT_VERSION")
    assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE


def test_a_stream_can_be_made_faster_stopped_and_put_back():
    flight = Flight()
    number = mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
    for period_us, hz in ((20_000, 50), (-1, 0), (0, 5)):
        assert flight.order(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, period_us) is Result.ACCEPTED
        before = len(flight.of("EXTENDED_SYS_STATE"))
        flight.run(2.0)
        assert len(flight.of("EXTENDED_SYS_STATE")) - before == pytest.approx(2 * hz, abs=1)
    assert flight.order(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 9999, 1000) is Result.DENIED


def test_a_command_int_is_obeyed_as_a_command_long():
    flight = Flight().run(1.0)
    flight.send(
        mavlink.MAVLink_command_int_message(
            1, 1, 0, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 0, 1, 0, 0, 0, 0, 0, 0
        )
    )
    flight.run(0.02)
    assert flight.commander.armed


def test_the_old_mode_switch_works():
    flight = Flight().hover()
    flight.send(
        mavlink.MAVLink_set_mode_message(1, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, Mode.LAND.custom_mode)
    )
    assert flight.run(0.02).mode is Mode.LAND


def test_a_mission_is_empty_and_cannot_be_uploaded():
    flight = Flight()
    flight.send(mavlink.MAVLink_mission_request_list_message(1, 1))
    flight.send(mavlink.MAVLink_mission_count_message(1, 1, 3))
    flight.run(0.01)
    assert flight.of("MISSION_COUNT")[0].count == 0
    assert flight.of("MISSION_ACK")[0].type == mavlink.MAV_MISSION_UNSUPPORTED


def test_a_ping_and_a_time_request_are_answered_to_their_sender():
    flight = Flight()
    flight.send(mavlink.MAVLink_ping_message(123, 7, 0, 0), system=42)
    flight.send(mavlink.MAVLink_timesync_message(0, 456))
    flight.run(0.01)
    (pong,) = flight.of("PING")
    assert (pong.time_usec, pong.seq, pong.target_system) == (123, 7, 42)
    assert flight.of("TIMESYNC")[0].ts1 == 456


def test_what_is_meant_for_another_vehicle_is_ignored():
    flight = Flight().run(1.0)
    flight.send(
        mavlink.MAVLink_command_long_message(
            2, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0
        )
    )
    flight.run(0.02)
    assert not flight.commander.armed
    assert not flight.of("COMMAND_ACK")


# Parameters


def test_the_parameter_list_is_whole_and_indexed():
    flight = Flight()
    flight.send(mavlink.MAVLink_param_request_list_message(1, 1))
    flight.run(0.01)
    told = flight.of("PARAM_VALUE")
    assert {message.param_id for message in told} == set(PARAMETERS)
    assert [message.param_index for message in told] == list(range(len(PARAMETERS)))
    assert {message.param_count for message in told} == {len(PARAMETERS)}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("COM_OF_LOSS_T", 1.0),
        ("COM_OBL_RC_ACT", 0),
        ("COM_RC_OVERRIDE", 1),
        ("MIS_TAKEOFF_ALT", 2.5),
        ("MPC_XY_VEL_MAX", 12.0),
        ("MPC_Z_VEL_MAX_UP", 3.0),
        ("MPC_Z_VEL_MAX_DN", 1.5),
        ("MC_YAWRATE_MAX", 200.0),
        ("GF_MAX_HOR_DIST", 0.0),
        ("GF_MAX_VER_DIST", 0.0),
    ],
)
def test_a_parameter_read_by_name_has_px4s_default(name, value):
    flight = Flight()
    flight.send(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
    flight.run(0.01)
    (told,) = flight.of("PARAM_VALUE")
    assert from_wire(Kind(told.param_type), told.param_value) == pytest.approx(value)


def test_a_parameter_that_is_set_is_told_and_obeyed():
    flight = Flight()
    flight.send(carried("COM_OBL_RC_ACT", 4))
    flight.run(0.01)
    assert flight.autopilot.parameters["COM_OBL_RC_ACT"] == 4
    assert from_wire(Kind.INT32, flight.of("PARAM_VALUE")[0].param_value) == 4


@pytest.mark.parametrize(
    "wrong",
    [
        mavlink.MAVLink_param_set_message(1, 1, b"COM_OF_LOSS_T", math.nan, Kind.REAL32),
        mavlink.MAVLink_param_set_message(1, 1, b"COM_OF_LOSS_T", -3.0, Kind.REAL32),
        mavlink.MAVLink_param_set_message(1, 1, b"COM_OF_LOSS_T", 5.0, Kind.INT32),
    ],
)
def test_a_parameter_that_cannot_be_is_answered_with_the_value_it_keeps(wrong):
    flight = Flight()
    flight.send(wrong)
    flight.run(0.01)
    assert flight.of("PARAM_VALUE")[0].param_value == 1.0


@given(st.integers(-(2**31), 2**31 - 1))
def test_whole_numbers_travel_byte_wise(value):
    quiet_nan = struct.pack("<i", value)
    if math.isnan(struct.unpack("<f", quiet_nan)[0]):
        return  # a pattern that is no number may change on its way through a float register
    assert from_wire(Kind.INT32, to_wire(Kind.INT32, value)) == value


# Hostile input

MESSAGES = sorted(mavlink.mavlink_map)
UNDERSTOOD = [number for number in MESSAGES if mavlink.mavlink_map[number].msgname in {*_HANDLERS, *SERVICES}]
NUMBERS = st.one_of(st.floats(width=32), st.integers(0, 255).map(float))


def any_message(data):
    """Decode random bytes as a well-formed message of a random kind: fields of every value."""
    kind = mavlink.mavlink_map[data.draw(st.sampled_from(UNDERSTOOD) | st.sampled_from(MESSAGES))]
    size = kind.unpacker.size
    payload = data.draw(st.binary(min_size=size, max_size=size))
    link = mavlink.MAVLink(None, srcSystem=data.draw(st.integers(0, 255)), srcComponent=190)
    packed = mavlink.MAVLink_message(kind.id, kind.msgname)._pack(link, kind.crc_extra, payload)
    return mavlink.MAVLink(None).decode(bytearray(packed))


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_no_message_crashes_the_autopilot_or_lifts_it_off(data):
    autopilot = Autopilot(STOCK, 0)
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    for tick in range(3):
        autopilot.receive(any_message(data))
        autopilot.step(Motion(on_gear=True), 0.004 * (tick + 1))
        for message in autopilot.transmit():
            message.pack(link)
    assert not autopilot.commander.armed


@settings(max_examples=100, deadline=None)
@given(
    st.tuples(*[NUMBERS] * 11),
    st.integers(0, 2**16 - 1),
    st.sampled_from([1, 7, 8, 9, 12, 0, 255]),
)
def test_whatever_a_set_point_asks_the_demand_is_finite_and_within_limits(numbers, mask, frame):
    autopilot = Autopilot(STOCK, 0)
    autopilot.commander.armed, autopilot.commander.landed = True, False
    autopilot.commander.mode = Mode.OFFBOARD
    autopilot.receive(mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, mask, *numbers))
    demand = autopilot.step(Motion(down=-2.0), 0.004)
    assert all(map(math.isfinite, demand))
    assert math.hypot(demand.forward, demand.right) <= 12.0 + 1e-6
    assert -3.0 <= demand.down <= 1.5
    assert abs(demand.yaw_rate) <= math.radians(200) + 1e-9
