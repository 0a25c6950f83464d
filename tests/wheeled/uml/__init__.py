"""Places with a real SocketCAN bus, ``vcan0``, in which any command can be run without root.

`room` says what such a place is, `choice` finds the one that this machine has: `namespace`, its own kernel,
or `launcher`, which boots a user-mode Linux kernel whose first process is `init`. `interfaces` makes vcan0
and takes it up and down. The ``cases_*`` are pytest files that need it; ``test_socketcan.py`` runs them.
`live_base` and `driver` are the two ends of the wire in them.
"""
