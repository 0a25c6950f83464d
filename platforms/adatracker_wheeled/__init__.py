"""The wheeled base: velocity commands over a CAN bus, by a DBC file and a profile that names the roles.

`protocol` (frames, pure) · `platform` (the adapter) · `body` (dynamics, pure) · `sitl` (the far end). Written
as a third party would write it: it uses only the toolkit's public interfaces.
"""
