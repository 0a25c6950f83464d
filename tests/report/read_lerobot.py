"""Reads a data set with lerobot's own reader, in an environment that has lerobot: ``FOLDER OUT.npz``."""

from __future__ import annotations

import sys

import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset

if __name__ == "__main__":
    found = LeRobotDataset("local/trials", root=sys.argv[1], video_backend="pyav")
    items = [found[place] for place in range(len(found))]
    columns = {
        key: [item[key] if isinstance(item[key], str) else item[key].numpy() for item in items]
        for key in items[0]
    }
    columns["statistics/action/mean"] = found.meta.stats["action"]["mean"]
    columns["rate_hz"] = found.fps
    columns["starts"] = [episode["dataset_from_index"] for episode in found.meta.episodes]
    np.savez(sys.argv[2], **{key: np.array(values) for key, values in columns.items()})
