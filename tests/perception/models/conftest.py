"""Fixtures of the tests of models that users bring as files."""

from __future__ import annotations

import pytest
import yaml

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.models.catalogue import open_model
from tests.perception.models import graphs


@pytest.fixture
def refusal():
    """Give a function that opens a model that is refused, and returns the one-sentence error."""

    def hear(path, *args, **kwargs):
        with pytest.raises(UsageError) as refused:
            open_model(path, *args, **kwargs)
        assert len(str(refused.value).splitlines()) == 1
        return str(refused.value)

    return hear


@pytest.fixture
def sidecar(tmp_path):
    """Give a function that writes model.yaml."""

    def write(**keys):
        path = tmp_path / "model.yaml"
        path.write_text(yaml.safe_dump(keys))
        return path

    return write


@pytest.fixture
def yolo(tmp_path):
    """Give a function that writes a YOLO file, changed by one function, and returns its path."""

    def write(change=None, **entries):
        path = tmp_path / "model.onnx"
        model = graphs.yolo_raw(path, metadata=graphs.metadata(**entries))
        if change is not None:
            change(model)
            path.write_bytes(model.SerializeToString())
        return path

    return write
