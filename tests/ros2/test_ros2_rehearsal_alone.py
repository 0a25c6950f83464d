"""A rehearsal commands its own simulated robot and no other, whoever is in the usual domain or its own."""

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'adatracker-deploy[ros2]'")

from adatracker_deploy.core.messages import Twist
from adatracker_deploy.registry import load_profile
from adatracker_ros2.platform import Ros2Platform
from adatracker_ros2.protocol.messages import TYPES
from adatracker_ros2.protocol.topics import TWIST, Topics
from tests.ros2.rehearsal import adapter, changed, node, rehearsed, send_while, simulator

pytestmark = pytest.mark.slow

CRUISE = Twist(vx=0.5)


@pytest.mark.parametrize("where", ["usual domain", "rehearsal's own domain"])
def test_a_foreign_robot_hears_nothing_of_a_rehearsal(where):
    with simulator(rehearsed()) as (_, profile):
        real = load_profile("ros2_robot", Ros2Platform)
        own = {"discovery": "localhost"} | (
            {} if where == "usual domain" else {"domain": profile.connection.domain}
        )
        foreign = changed(real, **own).connection
        heard = []
        with node(foreign, "foreign_robot") as participant:
            topic = Topics(foreign).command
            participant.node.create_subscription(TYPES[TWIST], topic, heard.append, 10)
            participant.start()
            with adapter(profile) as platform:
                platform.connect()
                assert [check for check in platform.preflight() if check.blocking and not check.ok] == []
                platform.engage()
                send_while(platform, CRUISE, lambda: platform.state().velocity.vx < 0.3)
                assert participant.node.count_publishers(topic) == 0
                platform.disengage()
        assert heard == []
