"""From camera frames to observations: camera sources, segmenters and the pipeline beside the loop."""
