"""Driving by hand: an operator's events, the takeover that follows from them, and the devices they come from.

`takeover` is pure: events with their times make a state, and a state makes a command. `hand` gives the loop
that command at each tick. `gamepad` and `keyboard` are the devices, `event_file` is a recording of one. The
command goes through the same link and gate as a policy's; nothing here reaches a robot by another way.
"""
