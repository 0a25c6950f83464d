"""A rover on wheels that speaks datagrams: the smallest complete robot for adatracker-deploy, to be copied.

This side of the wire: `protocol` (bytes, pure) · `settings` (the profile's two sections) · `wire` (socket and
thread) · `platform` (the adapter). The simulator: `body` (dynamics, pure) · `firmware` (its own rules, pure)
· `sitl` (its process).
"""
