"""Runs ONNX models in onnxruntime, on a chosen provider, and checks that their outputs are finite."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.onnx_session import OnnxSession, one_line
from adatracker_deploy.perception.models.model_file import ModelFile, Tensor

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
        model = str(file.path) if file.external else file.data
        self._session = OnnxSession(model, providers, where=str(file.path), threads=threads)
        self._refuse_half_precision()

    @property
    def provider(self) -> str:
        """The provider in use: the first that onnxruntime granted."""
        return self._session.provider

    def __str__(self) -> str:
        """Say in one line what runs where; a fall-back is named."""
        first = self._session.asked[0]
        told = "" if self.provider == first else f" ({first} was asked for and is unavailable)"
        name, digest = self.file.sha256[0]
        return f"{name} {digest[:12]} opset {self.file.opset} on {self._session.placement}{told}"

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
            raw = self._session.run([tensor.name for tensor in outputs], feeds)
        except Exception as error:
            raise PlatformError(f"{where}: fails to run: {one_line(error)}") from error
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

    def _refuse_half_precision(self) -> None:
        half = [tensor for tensor in self.file.inputs.values() if tensor.dtype == "float16"]
        if half and self.provider == "cpu":
            raise UsageError(
                f"{self.file.path}: takes half precision ({half[0]}), which a processor only imitates "
                "slowly: export it in float32, or run it on cuda"
            )
