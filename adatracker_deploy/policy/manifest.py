"""The manifest of a policy bundle, and the tensors that its networks must have. Data only: no files, no ONNX.

The runtime answers tick t with `policy(mask_t, z_t)`, where z_t comes from the K mask-action pairs of the
ticks t-K to t-1. A pair from before the episode is blank: a mask and an action of zeros. A policy whose graph
lists an input `last_action` is handed its own answer of tick t-1 as well, zeros at the first tick. One that
lists an input `belief` is handed what `belief.told` says of the masks up to t and its own answers up to t-1.
Where `search` replaces an answer, what replaced it counts as the answer.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from adatracker_deploy.config.schema import Range
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.policy import belief as gaps
from adatracker_deploy.policy import response as answering
from adatracker_deploy.policy.base import ActionAxis

FORMAT = 1
"""The bundle format that this code reads and writes."""

Interface = Literal["streaming", "window", "none"]
"""The call of the context encoder: a pair a tick, K pairs at once, or none."""

Colour = tuple[Annotated[int, Range(0, 255)], ...]
"""One value a channel of the drawn mask."""

PaletteEntry = Literal["random"] | Colour
"""A fixed colour, or one that is drawn anew for every episode."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Palette:
    """The colour of each class in a drawn mask."""

    background: Colour
    target: Colour
    person: PaletteEntry
    obstacle: PaletteEntry


@dataclass(frozen=True, slots=True, kw_only=True)
class MaskSpec:
    """The drawing of a class mask as a network's input."""

    size: Annotated[int, Range(8, 512)]
    """Rows and columns of the input, S."""
    channels: Literal[1, 3]
    draw_size: Annotated[int, Range(8, 1024)]
    """Rows and columns at which classes are drawn, before the bilinear reduction to `size`."""
    scale: Annotated[float, Range(1e-4, 1)]
    """The input is the drawn 0 to 255 value times this."""
    palette: Palette


@dataclass(frozen=True, slots=True, kw_only=True)
class TensorSpec:
    """One input or output of a graph; every dimension is a number."""

    name: str
    shape: tuple[Annotated[int, Range(1, 1 << 20)], ...]
    dtype: Literal["float32"] = "float32"


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphSpec:
    """The inputs and outputs of one ONNX graph; tensors are bound by name, so their order is free."""

    inputs: tuple[TensorSpec, ...]
    outputs: tuple[TensorSpec, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FileSpec:
    """The expected size and digest of a bundle's file."""

    sha256: str
    bytes: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Manifest:
    """A bundle's `manifest.yaml`."""

    format: int
    name: str
    interface: Interface
    opset: Annotated[int, Range(7, 100)]
    """The version of ONNX's own operators that the graphs use."""
    history: Annotated[int, Range(0, 1024)]
    """K, the pairs that the encoder remembers; 0 without an encoder."""
    context: Annotated[int, Range(0, 4096)]
    """The size of the encoder's z; 0 without an encoder."""
    response: bool = False
    """The policy's z goes on, after the encoder's, with what `response.told` says of the masks up to t and
    the policy's own answers up to t-1."""
    search: bool = False
    """The policy's answer gives way to a search once the target may have left the view (`policy.search`)."""
    mask: MaskSpec
    action: tuple[ActionAxis, ...]
    rate_hz: Annotated[float, Range(1, 100)]
    """The rate it was trained at, and is run at."""
    encoder: GraphSpec | None
    policy: GraphSpec
    training: str
    """A description of the training; its first line describes the policy in lists."""
    licence: str
    files: dict[str, FileSpec] = field(default_factory=dict)
    """By file name; filled in by `bundle.write_bundle`."""

    @property
    def told_context(self) -> int:
        """The size of the z that the policy is handed."""
        return self.context + (answering.SIZE if self.response else 0)

    @property
    def believes(self) -> bool:
        """Whether the policy is handed the belief across gaps."""
        return _last_dimension(self.policy, "belief") > 0


def graph_specs(
    interface: Interface,
    *,
    mask: MaskSpec,
    actions: int,
    hidden: int,
    context: int = 0,
    history: int = 0,
    features: int = 0,
    last_action: bool = False,
    belief: bool = False,
    response: bool = False,
) -> tuple[GraphSpec | None, GraphSpec]:
    """Return the inputs and outputs of the encoder (None without one) and of the policy.

    Args:
        interface: how the encoder is called.
        mask: the mask that both networks look at.
        actions: numbers in an action, A.
        hidden: size of the policy's LSTM state, H.
        context: size of z, Z.
        history: pairs remembered, K.
        features: numbers kept of one pair by a streaming encoder, F.
        last_action: the policy is handed its last answer.
        belief: the policy is handed the belief across gaps.
        response: its z goes on with the response of the body.
    """
    picture = (mask.channels, mask.size, mask.size)
    state, z = (1, 1, hidden), () if interface == "none" else (_tensor("z", 1, context),)
    whole = (_tensor("z", 1, context + answering.SIZE),) if response else z
    last = (_tensor("last_action", 1, actions),) if last_action else ()
    believed = (_tensor("belief", 1, gaps.SIZE),) if belief else ()
    policy = GraphSpec(
        inputs=(
            _tensor("mask", 1, *picture),
            *whole,
            *last,
            *believed,
            _tensor("h", *state),
            _tensor("c", *state),
        ),
        outputs=(_tensor("action", 1, actions), _tensor("h_next", *state), _tensor("c_next", *state)),
    )
    if interface == "none":
        return None, policy
    if interface == "window":
        pairs = (_tensor("masks", 1, history, *picture), _tensor("actions", 1, history, actions))
        return GraphSpec(inputs=pairs, outputs=z), policy
    pair = (_tensor("mask", 1, *picture), _tensor("action", 1, actions))
    remembered = (1, history, features)
    return GraphSpec(
        inputs=(*pair, _tensor("history", *remembered)), outputs=(*z, _tensor("history_next", *remembered))
    ), policy


def _tensor(name: str, *shape: int) -> TensorSpec:
    return TensorSpec(name=name, shape=shape)


def check_manifest(manifest: Manifest, *, where: str) -> None:
    """Refuse a manifest whose parts contradict each other.

    Args:
        manifest: typed and in range already.
        where: how errors name the place.

    Raises:
        UsageError: one line that names the place, the key and the reason.
    """
    remembers = manifest.interface != "none"
    for key in ("history", "context"):
        if (getattr(manifest, key) > 0) is not remembers:
            wanted = "at least 1" if remembers else "0"
            raise UsageError(f"{where}: {key} must be {wanted} where interface is {manifest.interface!r}")
    _check_palette(manifest.mask, where)
    axes = [entry.axis for entry in manifest.action]
    if not axes or len(axes) != len(set(axes)):
        raise UsageError(f"{where}: action must name at least one axis and none twice, got {axes}")
    encoder, policy = graph_specs(
        manifest.interface,
        mask=manifest.mask,
        actions=len(axes),
        hidden=_last_dimension(manifest.policy, "h"),
        context=manifest.context,
        history=manifest.history,
        features=_last_dimension(manifest.encoder, "history"),
        last_action=_last_dimension(manifest.policy, "last_action") > 0,
        belief=manifest.believes,
        response=manifest.response,
    )
    if manifest.response and manifest.encoder is None:
        raise UsageError(f"{where}: response without an encoder: it continues the encoder's z")
    if manifest.search and not manifest.believes:
        raise UsageError(f"{where}: search without a belief: it begins when that says so")
    if manifest.believes or manifest.response:
        _check_believer(manifest, where)
    _check_graph(manifest.encoder, encoder, f"{where}: encoder")
    _check_graph(manifest.policy, policy, f"{where}: policy")


def _check_palette(mask: MaskSpec, where: str) -> None:
    palette = mask.palette
    for key in ("background", "target", "person", "obstacle"):
        colour = getattr(palette, key)
        if colour != "random" and len(colour) != mask.channels:
            raise UsageError(
                f"{where}: mask.palette.{key}: expected {mask.channels} values, got {len(colour)}"
            )


def _check_believer(manifest: Manifest, where: str) -> None:
    """Refuse a belief or response that none can compute: the target's pixels and the drive must be known."""
    palette = manifest.mask.palette
    if palette.target in (palette.background, palette.person, palette.obstacle):
        raise UsageError(f"{where}: mask.palette.target must be a colour of its own for a belief or response")
    drives = {entry.axis for entry in manifest.action if entry.unit == "limit"}
    if not {"forward", "yaw"} <= drives:
        raise UsageError(
            f"{where}: action needs forward and yaw as fractions of the limits for a belief or response"
        )


def _last_dimension(graph: GraphSpec | None, name: str) -> int:
    """Return the size that only the graph itself states; 0 where it does not, which no tensor fits."""
    shapes = [tensor.shape for tensor in graph.inputs if tensor.name == name] if graph else []
    return shapes[0][-1] if shapes and shapes[0] else 0


def _check_graph(got: GraphSpec | None, wanted: GraphSpec | None, where: str) -> None:
    if got is None or wanted is None:
        if got is not wanted:
            raise UsageError(f"{where}: must be {'null' if wanted is None else 'given'} with this interface")
        return
    check_tensors(got.inputs, wanted.inputs, where=f"{where}.inputs")
    check_tensors(got.outputs, wanted.outputs, where=f"{where}.outputs")


def check_tensors(got: tuple[TensorSpec, ...], wanted: tuple[TensorSpec, ...], *, where: str) -> None:
    """Refuse tensors that are not the wanted ones, whatever their order.

    Raises:
        UsageError: one line that names the place and what was expected.
    """
    if sorted(map(_written, got)) != sorted(map(_written, wanted)):
        expected, found = (", ".join(map(_written, side)) or "nothing" for side in (wanted, got))
        raise UsageError(f"{where}: expected {expected}; got {found}")


def _written(tensor: TensorSpec) -> str:
    return f"{tensor.name} {list(tensor.shape)} {tensor.dtype}"
