"""Trials as a LeRobotDataset v3.0: `write_lerobot`, the features that it has, and their statistics.

The format is that of huggingface/lerobot (docs: "LeRobotDataset v3.0"; source: ``lerobot/datasets``): a
folder of ``meta/info.json``, ``stats.json``, ``tasks.parquet`` and ``episodes/``, of rows in ``data/`` and of
``videos/``. It is written here, because lerobot itself pins another torch; a test reads it with lerobot.
"""
