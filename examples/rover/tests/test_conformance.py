"""The rover keeps every promise of `Platform`, over its real wire, to a rover in a process of its own."""

from typing import ClassVar

from adatracker_deploy import Twist
from adatracker_deploy.testing.conformance import PlatformConformance

from adatracker_rover.platform import RoverPlatform


class TestRover(PlatformConformance):
    platform_class = RoverPlatform
    clock_speed = 5.0
    manual: ClassVar = {
        Twist(vx=0.5): "52 51 02 00 f4 01 00 00",  # forward, mm/s
        Twist(yaw_rate=0.2): "52 51 02 00 00 00 c8 00",  # counter-clockwise, mrad/s
    }
    says = "adatracker_rover.adapter.transport:encode_request"
