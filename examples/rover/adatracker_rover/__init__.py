"""A rover on wheels that speaks datagrams: the smallest complete robot for adatracker-deploy, to be copied.

`platform` joins three rooms. `adapter` drives a real rover: `adapter` (the rules of driving it), `transport`
(socket and thread). `protocol` is what both ends share: `messages` (bytes, pure), `connection` (the profile's
section). `sim` is the rover: `sitl` (its process), `firmware` (its own rules, pure), `dynamics`, `settings`.
"""
