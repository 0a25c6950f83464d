"""The rover keeps every promise of `Platform`, over its real wire, to a rover in a process of its own."""

from adatracker_deploy.testing.conformance import PlatformConformance

from adatracker_rover.platform import RoverPlatform


class TestRover(PlatformConformance):
    platform_class = RoverPlatform
    clock_speed = 5.0
