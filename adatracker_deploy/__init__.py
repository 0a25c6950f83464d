"""adatracker-deploy: take a visual person-following policy to real robots safely.

The package is the toolkit; it imports no robot library. Each robot is a package of its own, found through
the entry-point group ``adatracker_deploy.platforms``. `docs/architecture.md` shows the rooms and the way of
the data.
"""

__version__ = "0.1.0"
