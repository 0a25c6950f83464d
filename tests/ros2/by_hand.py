"""A ROS 2 robot as a stranger meets it: a simulator run by hand, and a watcher of plain rclpy."""

from __future__ import annotations

import contextlib
import math
import os
import secrets
import threading
from unittest import mock

import yaml
from nav_msgs.msg import Odometry
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data

from adatracker_deploy.registry import profile_dir
from adatracker_ros2.sim.domain import ReservedDomain
from tests.by_hand import simulator_by_hand
from tests.e2e.ground_robots import Watcher


class Ros2Robot:
    """The simulator's process in a domain of this machine, its profile, and who watches its odometry."""

    def __init__(self, folder, *arguments: str) -> None:
        self.watcher = Watcher()
        self._domain, token = ReservedDomain(), secrets.token_hex(16)
        document = yaml.safe_load((profile_dir() / "ros2_robot.yaml").read_text())
        document["limits"]["forward_m_s"] = 0.5  # the speed that the other robots' stops are measured at
        document["camera"]["rate_hz"] = 10  # two busy cores also draw its pictures
        document["connection"].update(
            domain=self._domain.number, discovery="localhost", rehearsal_token=token
        )
        self.profile = folder / "ros2_by_hand.yaml"
        self.profile.write_text(yaml.safe_dump(document))
        self._simulated = contextlib.ExitStack()
        self.simulator = self._simulated.enter_context(
            simulator_by_hand("adatracker_ros2.sim.sitl", "--profile", str(self.profile), *arguments)
        ).process
        self._watch(self._domain.number, f"/sitl_{token}/odom")

    def _watch(self, domain: int, topic: str) -> None:
        self._context, self._ending = Context(), threading.Event()
        with mock.patch.dict(os.environ, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}):
            self._context.init(args=[], domain_id=domain, initialize_logging=False)
            self._node = Node(
                "watcher", context=self._context, use_global_arguments=False, enable_rosout=False
            )
            self._executor = SingleThreadedExecutor(context=self._context)
        self._node.create_subscription(Odometry, topic, self._see, qos_profile_sensor_data)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _see(self, message: Odometry) -> None:
        velocity = message.twist.twist.linear
        self.watcher.see(math.hypot(velocity.x, velocity.y))

    def _spin(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            while not self._ending.is_set():
                self._executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        self._ending.set()
        self._thread.join()
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()
        self._simulated.close()
        self._domain.close()
