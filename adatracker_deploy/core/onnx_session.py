"""Starts ONNX networks in onnxruntime on a chosen execution provider, and tells what really runs where.

onnxruntime itself goes on without a word where an accelerator is missing: it takes the processor. Here that
is refused, unless the caller names the processor among the choices.
"""

from __future__ import annotations

import os
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import onnxruntime as ort

PROVIDERS = {
    "cpu": "CPUExecutionProvider",
    "cuda": "CUDAExecutionProvider",
    "tensorrt": "TensorrtExecutionProvider",
    "coreml": "CoreMLExecutionProvider",
}
"""Execution providers by the names that users write."""

DISTRIBUTIONS = ("onnxruntime", "onnxruntime-gpu")
"""Packages that bring the module `onnxruntime`; installed together they overwrite each other's files."""

_RECORD_PLACEMENT = "session.record_ep_graph_assignment_info"
"""onnxruntime's option to remember which provider took which node; versions that do not know it ignore it."""


class OnnxSession:
    """One ONNX graph at work."""

    def __init__(
        self,
        model: bytes | str,
        providers: Sequence[str] = ("cpu",),
        *,
        where: str,
        threads: int = 1,
        exact: bool = False,
    ) -> None:
        """Start it; nothing has run yet.

        Args:
            model: the file's content, or its path where its weights lie beside it.
            providers: keys of `PROVIDERS` in order of preference; only where `cpu` is among them may the
                processor stand in.
            where: the file, for errors.
            threads: for the processor's share of the work; they do not spin while they wait.
            exact: whole float32 on CUDA, too, which rounds to TF32 otherwise.

        Raises:
            UsageError: a provider is unknown, not in this onnxruntime or not to be had; onnxruntime cannot
                load the graph.
        """
        import onnxruntime as ort

        self.asked = tuple(providers)
        if not providers or threads < 1:
            raise UsageError(f"{where}: expected at least one provider and one thread")
        for name in providers:
            require_provider(name)
        options = ort.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.add_session_config_entry(_RECORD_PLACEMENT, "0" if self.asked == ("cpu",) else "1")
        options.log_severity_level = 4  # what is wrong is raised; nothing else belongs on a terminal
        kinds = _kinds(self.asked)
        settings = [_settings(kind, exact=exact) for kind in kinds]
        try:
            self._session = ort.InferenceSession(
                model,
                options,
                providers=kinds,
                provider_options=settings,
                enable_fallback=int("cpu" in self.asked),
            )
        except Exception as error:  # its exceptions share no base class of their own
            raise UsageError(f"{where}: onnxruntime cannot load it: {one_line(error)}") from error
        self._session.disable_fallback()  # else a run that fails would begin again on the processor, unsaid
        self.provider = _name(self._session.get_providers()[0])
        """The provider in use: the first that onnxruntime granted."""
        self.nodes = _nodes(self._session) if self.provider != "cpu" else {}
        """Nodes of the graph by the provider that took them; empty on a processor, and where this onnxruntime
        does not tell."""
        self._refuse_silent_fallback(where)

    @property
    def placement(self) -> str:
        """Say where it runs, as in ``cuda (of 120 nodes 3 on cpu)``."""
        elsewhere = ", ".join(
            f"{count} on {name}" for name, count in self.nodes.items() if name != self.provider
        )
        return self.provider + (f" (of {sum(self.nodes.values())} nodes {elsewhere})" if elsewhere else "")

    def run(self, outputs: Sequence[str], feeds: Mapping[str, Any]) -> list[Any]:
        """Return the named outputs as new arrays."""
        return self._session.run(outputs, feeds)  # type: ignore[no-any-return]

    def _refuse_silent_fallback(self, where: str) -> None:
        if self.provider not in self.asked:
            raise UsageError(
                f"{where}: {self.asked[0]} is not available here, only {self.provider}: repair the "
                f"driver, or ask for {', '.join(self.asked)}, {self.provider}"
            )
        if self.nodes and self.provider not in self.nodes and "cpu" not in self.asked:
            raise UsageError(
                f"{where}: {self.provider} takes none of its {sum(self.nodes.values())} nodes, so all of it "
                "would run on the processor: ask for cpu, or for a model that this accelerator supports"
            )


def available_providers() -> tuple[str, ...]:
    """Return the keys of `PROVIDERS` that this onnxruntime was built with."""
    import onnxruntime as ort

    kinds = ort.get_available_providers()
    return tuple(name for name, kind in PROVIDERS.items() if kind in kinds)


def require_provider(name: str) -> None:
    """Check that this onnxruntime was built with a provider.

    Raises:
        UsageError: it was not, or no such provider is known.
    """
    available = available_providers()
    names = ", ".join(available)
    if name not in PROVIDERS:
        raise UsageError(
            f"provider {name!r} is unknown; known are {', '.join(PROVIDERS)}, of which this onnxruntime has "
            f"{names}"
        )
    if name not in available:
        raise UsageError(
            f"provider {name!r} is not in this onnxruntime, which has {names}: install the onnxruntime built "
            "for this device in its place (onnxruntime-gpu for cuda and tensorrt), never beside it"
        )


def runtime_distributions() -> dict[str, str]:
    """Return the installed packages that bring onnxruntime, with their versions."""
    found = {}
    for name in DISTRIBUTIONS:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def one_line(error: Exception) -> str:
    """Return an error's text without line breaks."""
    return " ".join(str(error).split())


def _kinds(asked: Sequence[str]) -> list[str]:
    """Return onnxruntime's names; what TensorRT leaves of a graph runs on CUDA and not on the processor."""
    names = list(asked)
    if "tensorrt" in names and "cuda" not in names:
        names.insert(names.index("tensorrt") + 1, "cuda")
    return [PROVIDERS[name] for name in names]


def _settings(kind: str, *, exact: bool) -> dict[str, str]:
    if kind == PROVIDERS["cuda"] and exact:
        return {"use_tf32": "0"}
    if kind == PROVIDERS["tensorrt"]:  # an engine takes minutes to build: once for each model and device
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "adatracker-deploy"
        return {"trt_engine_cache_enable": "1", "trt_engine_cache_path": str(cache / "tensorrt")}
    return {}


def _name(kind: str) -> str:
    return next((name for name, known in PROVIDERS.items() if known == kind), kind)


def _nodes(session: ort.InferenceSession) -> dict[str, int]:
    """Count the nodes of the graph by provider; empty where this onnxruntime does not tell."""
    if not hasattr(session, "get_provider_graph_assignment_info"):
        return {}
    counts: dict[str, int] = {}
    for part in session.get_provider_graph_assignment_info():
        name = _name(part.ep_name)
        counts[name] = counts.get(name, 0) + len(part.get_nodes())
    return counts
