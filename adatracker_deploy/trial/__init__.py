"""Trials: the log's writer and reader, live view and operator marks. Independent of robots and policies."""
