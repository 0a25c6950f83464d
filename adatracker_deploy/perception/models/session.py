"""Runs ONNX models in onnxruntime, on a chosen provider, and checks that their outputs are finite."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.perception.models.model_file import ModelFile, Tensor

PROVIDERS = {
    "cpu": "CPUExecutionProvider",
    "cuda": "CUDAExecutionProvider",
    "tensorrt": "TensorrtExecutionProvider",
}
"""Execution providers by the names that users write."""

Feed = NDArray[Any]
Values = NDArray[np.float32]


class Network:
    """One ONNX graph at work."""

    def __init__(self, file: ModelFile, providers: Sequence[str] = ("cpu",), threads: int = 1) -> None:
        """Start it; nothing has run yet.

        Args:
            file: the model.
            providers: in order of preference; only where `cpu` is among them may the processor stand in.
            threads: for the processor's share of the work; they do not spin while they wait.

        Raises:
            UsageError: a provider is unknown, not in this onnxruntime or not to be had; the graph takes
                half precision and runs on a processor; onnxruntime cannot load it.
        """
        self.file = file
        self.asked = tuple(providers)
        kinds = [_kind(name) for name in providers]
        if not kinds or threads < 1:
            raise UsageError(f"{file.path}: expected at least one provider and one thread")
        options = ort.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.log_severity_level = 4  # what is wrong is raised; nothing else belongs on a terminal
        model = str(file.path) if file.external else file.data
        try:
            self._session = ort.InferenceSession(model, options, providers=kinds)
        except Exception as error:  # its exceptions share no base class of their own
            raise UsageError(f"{file.path}: onnxruntime cannot load it: {_one_line(error)}") from error
        self._check_device()

    @property
    def provider(self) -> str:
        """Where it really runs: the first provider that onnxruntime granted."""
        granted = self._session.get_providers()[0]
        return next((name for name, kind in PROVIDERS.items() if kind == granted), granted)

    def __str__(self) -> str:
        """Say in one line what runs where; a fall-back is told."""
        told = (
            "" if self.provider == self.asked[0] else f" ({self.asked[0]} was asked for and is not to be had)"
        )
        name, digest = self.file.sha256[0]
        return f"{name} {digest[:12]} opset {self.file.opset} on {self.provider}{told}"

    def run(
        self, feeds: Mapping[str, Feed], outputs: Sequence[Tensor], *, may_be_absent: Collection[str] = ()
    ) -> list[Values]:
        """Return the outputs as float32.

        Args:
            feeds: by the file's own names.
            outputs: what is wanted, as the file declares it.
            may_be_absent: names of outputs that write minus infinity where there is nothing.

        Raises:
            PlatformError: the run failed, or a number is not finite, or a shape is not the declared one.
        """
        where = self.file.path.name
        try:
            raw = self._session.run([tensor.name for tensor in outputs], dict(feeds))
        except Exception as error:
            raise PlatformError(f"{where}: fails to run: {_one_line(error)}") from error
        values = []
        for tensor, got in zip(outputs, raw, strict=True):
            if len(got.shape) != len(tensor.shape) or any(
                wanted not in (None, size) for wanted, size in zip(tensor.shape, got.shape, strict=True)
            ):
                raise PlatformError(f"{where}: gave {tensor.name} {list(got.shape)}; it declares {tensor}")
            value = np.asarray(got, np.float32)
            sound = value < np.inf if tensor.name in may_be_absent else np.isfinite(value)
            if not sound.all():
                raise PlatformError(f"{where}: gave {tensor.name} with numbers that are not finite")
            values.append(value)
        return values

    def _check_device(self) -> None:
        if self.provider not in self.asked:
            raise UsageError(
                f"{self.file.path}: {self.asked[0]} is not to be had here, only {self.provider}: mend the "
                f"driver, or ask for {', '.join(self.asked)}, {self.provider}"
            )
        half = [tensor for tensor in self.file.inputs.values() if tensor.dtype == "float16"]
        if half and self.provider == "cpu":
            raise UsageError(
                f"{self.file.path}: takes half precision ({half[0]}), which a processor only imitates "
                "slowly: export it in float32, or run it on cuda"
            )


def _kind(name: str) -> str:
    available = ort.get_available_providers()
    names = [known for known, kind in PROVIDERS.items() if kind in available]
    if name not in PROVIDERS:
        raise UsageError(
            f"provider {name!r} is unknown; known are {', '.join(PROVIDERS)}, of which this onnxruntime has "
            f"{', '.join(names)}"
        )
    if PROVIDERS[name] not in available:
        raise UsageError(
            f"provider {name!r} is not in this onnxruntime, which has {', '.join(names)}: install the "
            "onnxruntime built for this device (onnxruntime-gpu for cuda and tensorrt)"
        )
    return PROVIDERS[name]


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
