"""``python -m adatracker_quadruped.robot`` runs the node."""

import sys

from adatracker_quadruped.robot.node import main

sys.exit(main())
