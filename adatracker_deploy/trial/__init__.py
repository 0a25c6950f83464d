"""Trials: the log's writer and reader, metrics and tables. Knows nothing of robots or policies."""
