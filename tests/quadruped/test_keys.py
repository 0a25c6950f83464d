"""Keys and attachments as the bridge and rmw_zenoh write them."""

from dataclasses import replace

import pytest
import zenoh
import zenoh.ext
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from adatracker_quadruped.protocol import cdr as protocol
from adatracker_quadruped.protocol import keys, sport
from adatracker_quadruped.protocol.connection import Connection
from adatracker_quadruped.protocol.keys import Keys, attachment, parse_attachment
from adatracker_quadruped.protocol.messages import Malformed

PUBLISHED = {
    "geometry_msgs/msg/Twist": "9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    "geometry_msgs/msg/TwistStamped": "5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64",
    "nav_msgs/msg/Odometry": "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    "sensor_msgs/msg/Imu": "7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
    "sensor_msgs/msg/BatteryState": "4bee5dfce981c98faa6828b868307a0a73f992ed0789f374ee96c8f840e69741",
    "sensor_msgs/msg/CompressedImage": "15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a",
}
"""``type_hashes`` in the ``share/<package>/msg/*.json`` of ROS 2's binary releases (Jazzy, Kilted)."""

DISTRIBUTIONS = [store for store in Stores if store.name.startswith("ROS2_")]
EVERYTHING = Connection(
    command_topic="/cmd_vel",
    odometry_topic="odom",
    imu_topic="/imu/data",
    battery_topic="battery_state",
    camera_topic="/camera/image_raw/compressed",
)
NAMES = ["command", "odometry", "imu", "battery", "camera"]


def replaced(**changes):
    return Keys(replace(EVERYTHING, **changes))


def test_the_bridge_uses_the_topics_without_their_slash():
    assert [getattr(Keys(EVERYTHING), name) for name in NAMES] == [
        "cmd_vel",
        "odom",
        "imu/data",
        "battery_state",
        "camera/image_raw/compressed",
    ]


@pytest.mark.parametrize("namespace", ["spot/left", "/spot/left"])
def test_the_bridge_puts_its_namespace_before_every_topic(namespace):
    assert replaced(namespace=namespace).command == "spot/left/cmd_vel"
    assert replaced(namespace=namespace).camera == "spot/left/camera/image_raw/compressed"


def test_rmw_zenoh_adds_the_domain_the_type_and_its_hash():
    spoken = replaced(dialect="rmw_zenoh", domain=42, camera_topic="front")
    written = {
        "cmd_vel/geometry_msgs::msg::dds_::Twist_": "geometry_msgs/msg/Twist",
        "odom/nav_msgs::msg::dds_::Odometry_": "nav_msgs/msg/Odometry",
        "imu/data/sensor_msgs::msg::dds_::Imu_": "sensor_msgs/msg/Imu",
        "battery_state/sensor_msgs::msg::dds_::BatteryState_": "sensor_msgs/msg/BatteryState",
        "front/sensor_msgs::msg::dds_::CompressedImage_": "sensor_msgs/msg/CompressedImage",
    }
    expected = [f"42/{start}/RIHS01_{PUBLISHED[name]}" for start, name in written.items()]
    assert [getattr(spoken, name) for name in NAMES] == expected


def test_rmw_zenoh_keeps_a_namespace_inside_the_topic():
    spoken = replaced(dialect="rmw_zenoh", namespace="/spot", command="twist_stamped")
    stamped = PUBLISHED["geometry_msgs/msg/TwistStamped"]
    assert spoken.command == f"0/spot/cmd_vel/geometry_msgs::msg::dds_::TwistStamped_/RIHS01_{stamped}"


def test_humble_has_no_hashes():
    spoken = replaced(dialect="rmw_zenoh", type_hashes=False)
    assert spoken.command == "0/cmd_vel/geometry_msgs::msg::dds_::Twist_/TypeHashNotSupported"


def test_a_sport_request_goes_to_its_own_topic():
    changes = {"command": "unitree_sport", "command_topic": "/api/sport/request"}
    assert replaced(**changes).command == "api/sport/request"
    assert replaced(**changes, dialect="rmw_zenoh").command.startswith(
        "0/api/sport/request/unitree_api::msg::dds_::Request_/RIHS01_"
    )


def test_a_topic_that_is_not_there_has_no_key():
    for dialect in ("ros2dds", "rmw_zenoh"):
        assert Keys(Connection(dialect=dialect)).imu == ""


@pytest.mark.parametrize("dialect", ["ros2dds", "rmw_zenoh"])
def test_every_key_is_one_to_zenoh(dialect):
    for name in NAMES:
        key = getattr(replaced(dialect=dialect, namespace="/a/b"), name)
        assert str(zenoh.KeyExpr(key)) == key


@pytest.mark.parametrize("type_name", PUBLISHED)
def test_the_hashes_are_those_that_ros_publishes(type_name):
    assert protocol.STORE.hash_rihs01(type_name) == f"RIHS01_{PUBLISHED[type_name]}"


@pytest.mark.parametrize("store", DISTRIBUTIONS, ids=lambda store: store.name)
def test_every_distribution_of_ros_2_has_the_same_messages(store):
    types = get_typestore(store)
    assert {name: types.hash_rihs01(name).removeprefix("RIHS01_") for name in PUBLISHED} == PUBLISHED


def test_only_rmw_zenoh_attaches():
    assert not replaced().attaches
    assert replaced(dialect="rmw_zenoh").attaches


@given(
    st.integers(-(2**63), 2**63 - 1),
    st.integers(-(2**63), 2**63 - 1),
    st.binary(min_size=keys.GID_BYTES, max_size=keys.GID_BYTES),
)
def test_an_attachment_is_what_zenoh_itself_serialises(sequence, t_ns, gid):
    payload = attachment(sequence, t_ns, gid)
    fields = (zenoh.ext.Int64(sequence), zenoh.ext.Int64(t_ns), gid)
    assert payload == bytes(zenoh.ext.z_serialize(fields))
    assert parse_attachment(payload) == (sequence, t_ns, gid)


def test_the_bytes_of_an_attachment_are_these():
    gid = bytes(range(16))
    expected = "0100000000000000" + "0200000000000000" + "10" + gid.hex()
    assert attachment(1, 2, gid).hex() == expected


def test_a_short_identity_is_filled_up_with_zeros():
    assert parse_attachment(attachment(1, 2, b"zid")) == (1, 2, b"zid" + bytes(13))


@given(st.binary(max_size=80))
def test_what_is_no_attachment_is_malformed(payload):
    if len(payload) == 33 and payload[16] == 16:
        return
    with pytest.raises(Malformed, match="not rmw_zenoh's"):
        parse_attachment(payload)


def test_an_attachment_with_another_gid_is_malformed():
    payload = bytearray(attachment(1, 2, bytes(16)))
    payload[16] = 15
    with pytest.raises(Malformed):
        parse_attachment(bytes(payload))


def test_the_sport_request_is_defined_as_unitree_defines_it():
    definition, _ = protocol.STORE.generate_msgdef(sport.REQUEST, ros_version=2)
    lines = [line for line in definition.splitlines() if " " in line]
    assert lines == [
        "unitree_api/RequestHeader header",
        "string parameter",
        "uint8[] binary",
        "MSG: unitree_api/RequestHeader",
        "unitree_api/RequestIdentity identity",
        "unitree_api/RequestLease lease",
        "unitree_api/RequestPolicy policy",
        "MSG: unitree_api/RequestIdentity",
        "int64 id",
        "int64 api_id",
        "MSG: unitree_api/RequestLease",
        "int64 id",
        "MSG: unitree_api/RequestPolicy",
        "int32 priority",
        "bool noreply",
    ]
