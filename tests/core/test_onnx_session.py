"""An accelerator that is asked for is really used, or refused in a sentence."""

from __future__ import annotations

import json
from types import SimpleNamespace

import onnxruntime
import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.core import onnx_session
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.onnx_session import OnnxSession, runtime_distributions
from adatracker_deploy.policy.bundle import load_bundle
from adatracker_deploy.policy.onnx_policy import OnnxPolicy
from tests.policy import tiny

CUDA, CPU = "CUDAExecutionProvider", "CPUExecutionProvider"
REAL = onnxruntime.InferenceSession
TENSORRT = "TensorrtExecutionProvider"


def runtime(monkeypatch, granted, nodes):
    """Make this machine's onnxruntime say that it has accelerators, grants these and places nodes so.

    What runs is the processor: only what onnxruntime reports of itself is replaced.
    """
    asked = []

    class Reporting(REAL):
        def __init__(self, model, options, providers, provider_options, enable_fallback):
            asked.extend(zip(providers, provider_options, strict=True))
            super().__init__(model, options, providers=[CPU], enable_fallback=enable_fallback)

        def get_providers(self):
            return granted

        def get_provider_graph_assignment_info(self):
            return [
                SimpleNamespace(ep_name=kind, get_nodes=lambda count=count: [None] * count)
                for kind, count in nodes
            ]

    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: [TENSORRT, CUDA, CPU])
    monkeypatch.setattr(onnxruntime, "InferenceSession", Reporting)
    return asked


@pytest.fixture
def bundle(tmp_path):
    tiny.Parts("streaming").write(tmp_path)
    return load_bundle(tmp_path)


def test_a_policy_runs_on_the_processor_unless_it_is_told_otherwise(bundle):
    assert OnnxPolicy(bundle).info.runs_on == "cpu"


def test_a_policy_says_which_nodes_its_accelerator_left_to_the_processor(bundle, monkeypatch):
    asked = runtime(monkeypatch, [CUDA, CPU], [(CUDA, 40), (CPU, 2), (CUDA, 1)])
    assert OnnxPolicy(bundle, ("cuda",)).info.runs_on == "cuda (of 43 nodes 2 on cpu)"
    assert set(map(str, asked)) == {str((CUDA, {"use_tf32": "0"}))}  # golden vectors are of whole float32


def test_a_policy_whose_accelerator_is_not_granted_is_refused(bundle, monkeypatch):
    runtime(monkeypatch, [CPU], [])
    with pytest.raises(UsageError, match=r"encoder.onnx: cuda is not available here, only cpu: repair"):
        OnnxPolicy(bundle, ("cuda",))


def test_an_accelerator_that_is_granted_and_takes_nothing_is_refused(bundle, monkeypatch):
    runtime(monkeypatch, [CUDA, CPU], [(CPU, 30)])
    with pytest.raises(UsageError, match=r"encoder.onnx: cuda takes none of its 30 nodes"):
        OnnxPolicy(bundle, ("cuda",))
    session = OnnxSession(bundle.policy, ("cuda", "cpu"), where="policy.onnx")  # the processor may stand in
    assert session.placement == "cuda (of 30 nodes 30 on cpu)"


def test_what_tensorrt_leaves_runs_on_cuda_which_does_not_stand_in_for_it(bundle, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    asked = runtime(monkeypatch, [TENSORRT, CUDA, CPU], [(TENSORRT, 7), (CUDA, 2)])
    session = OnnxSession(bundle.policy, ("tensorrt",), where="policy.onnx")
    assert [kind for kind, _ in asked] == [TENSORRT, CUDA]
    assert asked[0][1]["trt_engine_cache_path"] == str(tmp_path / "adatracker-deploy" / "tensorrt")
    assert session.placement == "tensorrt (of 9 nodes 2 on cuda)"
    runtime(monkeypatch, [CUDA, CPU], [(CUDA, 9)])
    with pytest.raises(UsageError, match="tensorrt is not available here, only cuda"):
        OnnxSession(bundle.policy, ("tensorrt",), where="policy.onnx")


@pytest.mark.parametrize("command", [("--platform", "wheeled", "--sitl"), ("doctor",)])
def test_a_command_refuses_an_accelerator_that_is_not_there_before_anything_moves(capsys, tmp_path, command):
    if "cuda" in onnx_session.available_providers():
        pytest.skip("this onnxruntime has CUDA")
    logs = "--log-dir", str(tmp_path / "trials")
    assert main([*command, *logs, "--provider", "cuda"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "provider 'cuda' is not in this onnxruntime" in line
    assert not (tmp_path / "trials").exists()


def test_onnxruntime_comes_from_one_package():
    assert len(runtime_distributions()) == 1, json.dumps(runtime_distributions())
