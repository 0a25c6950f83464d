"""The public interface: what the stub says is what there is."""

from __future__ import annotations

import ast
from pathlib import Path

import adatracker_deploy

STUB = ast.parse(Path(adatracker_deploy.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))


def test_every_public_name_is_imported_named_and_loaded():
    imported = [name.name for node in STUB.body if isinstance(node, ast.ImportFrom) for name in node.names]
    (named,) = [
        ast.literal_eval(node.value)
        for node in STUB.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    ]
    assert sorted(imported) == sorted(named) == sorted(adatracker_deploy.__all__)
    for name in named:
        assert getattr(adatracker_deploy, name) is not None


def test_no_public_name_is_a_modules():
    """Else the module, once something else has imported it, would be found in the name's place."""
    rooms = {path.stem for path in Path(adatracker_deploy.__file__).parent.iterdir()}
    assert not rooms & set(adatracker_deploy.__all__)
