"""The training side (needs the train extra): networks and export. Nothing that runs on a robot imports it."""
