"""The wheeled base: velocity commands over a CAN bus, by a DBC file and a profile that names the roles.

Bytes, without I/O: `protocol` (frames and readings as values) · `roles` (what a profile says of its messages)
· `codec` (between the two, made of `dbc`, `part`, `status`, `dispatch` and `checksum`) · `drive` and
`dead_reckoning` (geometry). Around them: `platform` (the adapter) · `body` (dynamics, pure) · `sitl` (the far
end). Written as a third party would write it: it uses only the toolkit's public interfaces.
"""
