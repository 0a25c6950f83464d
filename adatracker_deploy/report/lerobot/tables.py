"""Tables of the data set, as Parquet: rows of ticks, of episodes and of tasks."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from adatracker_deploy.report.lerobot.features import Columns

_TASK = "task"


def rows_table(numbers: Columns, pictures: Mapping[str, Sequence[bytes]]) -> pa.Table:
    """Return an episode's rows.

    Args:
        numbers: (N, D) or (N,) by feature.
        pictures: N encoded images by feature.
    """
    arrays = {key: _numbers(values) for key, values in numbers.items()}
    for key, images in pictures.items():
        paths = pa.nulls(len(images), pa.string())
        arrays[key] = pa.StructArray.from_arrays([pa.array(images, pa.binary()), paths], ["bytes", "path"])
    return pa.table(arrays)


def tasks_table(tasks: Sequence[str]) -> pa.Table:
    """Return the tasks, numbered; pandas takes their words for the index of what it reads."""
    table = pa.table({"task_index": pa.array(range(len(tasks)), pa.int64()), _TASK: pa.array(tasks)})
    column = {"metadata": None, "numpy_type": "object", "pandas_type": "unicode"}
    told = {
        "index_columns": [_TASK],
        "column_indexes": [],
        "columns": [
            {**column, "name": "task_index", "field_name": "task_index"}
            | {"numpy_type": "int64", "pandas_type": "int64"},
            {**column, "name": _TASK, "field_name": _TASK},
        ],
        "pandas_version": "2.0.0",
    }
    return table.replace_schema_metadata({"pandas": json.dumps(told)})


def write_rows(path: Path, episodes: Sequence[pa.Table]) -> None:
    """Write episodes to one file, each as a row group of its own, which a reader can fetch alone."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with pq.ParquetWriter(path, episodes[0].schema) as file:
        for table in episodes:
            file.write_table(table, row_group_size=len(table))


def write_table(path: Path, table: pa.Table) -> None:
    """Write a table to one file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, path)


def episodes_table(rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Return what is known of each episode; all rows have the same keys."""
    return pa.Table.from_pylist([dict(row) for row in rows])


def _numbers(values: NDArray[Any]) -> pa.Array:
    if values.ndim == 1:
        return pa.array(values)
    return pa.FixedSizeListArray.from_arrays(pa.array(np.ascontiguousarray(values).ravel()), values.shape[1])
