"""adatracker-deploy: take a visual person-following policy to real robots safely.

The names below are the public interface, with `adatracker_deploy.sim` (a robot's simulator) and
`adatracker_deploy.testing` (the conformance suite): a robot from outside needs nothing else, and the other
modules may move between minor versions. No robot's library is imported here: each robot is a package of its
own, found by the entry-point group ``adatracker_deploy.platforms``. `docs/architecture.md` shows the rooms.
"""

import lazy_loader

__version__ = "0.1.0"

# Loaded at first use: whatever imports a module of the toolkit, such as `stop`, imports this one, too.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
