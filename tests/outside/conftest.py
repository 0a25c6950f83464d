"""The rover is a project of its own; its tests run where it is installed (`test_outside_robot`)."""

collect_ignore = ["rover"]
