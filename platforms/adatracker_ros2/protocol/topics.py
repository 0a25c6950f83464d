"""Full names of a connection's topics and node, and their types. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from adatracker_ros2.protocol.connection import Connection

TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
BATTERY_STATE = "sensor_msgs/msg/BatteryState"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
IMAGE = "sensor_msgs/msg/Image"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"

_TRANSPORT = "/compressed"
"""Ending of the one transport of images that is read here (image_transport)."""
_COMMAND_TYPES = {"twist": TWIST, "twist_stamped": TWIST_STAMPED}


class Topics:
    """The names as ROS 2 expands them: relative ones under the namespace, absolute ones as they are.

    In a rehearsal all of them, absolute ones too, are under a random name of 128 bits. So whatever reaches
    whom, a rehearsal and a robot have no topic in common. The last three are a simulated robot's alone:
    ``sitl/truth`` has the truth of each image under the image's stamp, before the image; what comes on
    ``sitl/go`` lets the people in its world walk.
    """

    def __init__(self, connection: Connection) -> None:
        self._rehearsal = f"/sitl_{connection.rehearsal_token}" if connection.rehearsal_token else ""
        self._namespace = f"/{connection.namespace.strip('/')}" if connection.namespace else ""
        self.command = self.full(connection.command_topic)
        self.command_type = _COMMAND_TYPES[connection.command]
        self.odometry = self.full(connection.odometry_topic)
        self.battery = self.full(connection.battery_topic)
        self.camera = self.full(connection.camera_topic)
        self.camera_info = self.full(connection.camera_info_topic or beside(connection.camera_topic))
        self.driver = self.full(connection.driver_node)
        self.robot = self.full(connection.driver_node or "robot")
        """The simulated robot's node."""
        self.truth = self.full("sitl/truth")
        self.go = self.full("sitl/go")

    def full(self, name: str) -> str:
        """Return a name in full; empty for an empty one."""
        if not name:
            return ""
        return self._rehearsal + (name if name.startswith("/") else f"{self._namespace}/{name}")


def claimed(connection: Connection) -> str:
    """Name the robot's command topic: the same in every run on this machine that would publish there."""
    return f"ros2:{connection.domain}:{Topics(connection).command}"


def beside(images: str) -> str:
    """Return the topic of sensor_msgs/CameraInfo that belongs to a topic of images; empty for an empty one.

    The rule is image_transport's (``getCameraInfoTopic``): the last name of the images' own topic, without
    its transport, becomes ``camera_info``.
    """
    if not images:
        return ""
    namespace, slash, _ = images.removesuffix(_TRANSPORT).rpartition("/")
    return f"{namespace}{slash}camera_info"


def is_rectified(images: str) -> bool:
    """Return whether images are rectified, by the names that image_proc gives them: ``image_rect``, ..."""
    return images.removesuffix(_TRANSPORT).rpartition("/")[2].startswith("image_rect")
