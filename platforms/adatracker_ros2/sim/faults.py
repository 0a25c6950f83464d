"""Faults of a simulated ROS 2 robot, by the names that ``--fault`` takes."""

from __future__ import annotations

from adatracker_deploy.core import faults as catalogue

FROZEN_ODOMETRY = catalogue.Fault(
    "frozen_odometry", "the odometry repeats the last measurement, stamp and all", 2.0
)
ON_DEMAND = (
    catalogue.CAMERA_FREEZE,
    catalogue.CAMERA_GONE,
    catalogue.LINK_DROP,
    catalogue.ROBOT_SILENT,
    catalogue.TAKEOVER,
    catalogue.BATTERY_LOW,
    FROZEN_ODOMETRY,
)
"""All that a rehearsal may ask for; a takeover is another node that publishes on the command topic."""
