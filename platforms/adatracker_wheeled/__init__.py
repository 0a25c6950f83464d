"""The wheeled base: velocity commands over a CAN bus, by a DBC file and a profile that names the roles.

`roles`, `protocol` and `codec` (what bytes mean, pure) · `platform` (the adapter, on `wire`, `bus` and
`transmitter`) · `body` (dynamics, pure), `base` (a base's own controller, pure) and `sitl` (the far end).
Written as a third party would write it: it uses only the toolkit's public interfaces.
"""
