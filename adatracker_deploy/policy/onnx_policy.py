"""Runs a policy bundle: one mask in, one action out, with its state kept between ticks.

The networks run on one thread that never spins: at 20 Hz spinning threads would burn most of a core and
starve the camera. Inputs are handed over without a copy, and the networks' own outputs become their next
inputs.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Action
from adatracker_deploy.core.onnx_session import OnnxSession, one_line
from adatracker_deploy.policy import belief
from adatracker_deploy.policy.base import PolicyInfo
from adatracker_deploy.policy.bundle import ENCODER_NAME, GOLDEN_NAME, POLICY_NAME
from adatracker_deploy.policy.drawing import MaskPainter
from adatracker_deploy.policy.golden import GOLDEN_TICKS, GOLDEN_TOLERANCE
from adatracker_deploy.policy.past import Past
from adatracker_deploy.policy.search import with_search

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adatracker_deploy.core.messages import Observation
    from adatracker_deploy.policy.bundle import Bundle, GraphSpec

Array = NDArray[np.float32]


class OnnxPolicy:
    """Implements `Policy` over a bundle."""

    def __init__(self, bundle: Bundle, providers: Sequence[str] = ("cpu",)) -> None:
        """Start the networks and run the golden vectors, which also warms them up.

        Args:
            bundle: the networks and what they expect.
            providers: where to run them, by preference: keys of `PROVIDERS`.

        Raises:
            UsageError: a network cannot run here, or answers otherwise than it did when it was exported.
        """
        manifest = bundle.manifest
        self._mask = manifest.mask
        self._painter = MaskPainter(manifest.mask)
        self._past = Past(
            believes=manifest.believes, responds=manifest.response, period_s=1.0 / manifest.rate_hz
        )
        self._searches = manifest.search
        self._encoder = _encoder(bundle, providers)
        self._policy = _Network(
            bundle.policy, manifest.policy, providers, where=f"{bundle.folder}/{POLICY_NAME}"
        )
        self._info = PolicyInfo(
            name=manifest.name,
            rate_hz=manifest.rate_hz,
            action=manifest.action,
            sha256=bundle.sha256,
            source=bundle.source,
            runs_on=self._policy.session.placement,
        )
        self.reset()
        _check_answers(self, bundle)
        self.reset()

    @property
    def info(self) -> PolicyInfo:
        """The policy's description, from its manifest."""
        return self._info

    def reset(self, seed: int = 0) -> None:
        """Forget everything; draw this episode's random colour from `seed`."""
        self._painter.reset(seed)
        self._policy.clear()
        self._imposed: Array | None = None
        self._past.forget()
        self._last_action = np.zeros(len(self._info.action), np.float32)
        self._searching = False
        if self._encoder is not None:
            self._encoder.reset()

    def override_context(self, context: Array) -> None:
        """Override the context: answer with this z, as long as the policy's, until the next reset."""
        self._imposed = np.asarray(context, np.float32)[None]

    def act(self, observation: Observation) -> Action:
        """Paint the observation's mask and answer it."""
        values, context = self.step(self._painter.paint(observation.mask))
        return Action(values, context, searching=self._searching)

    def picture(self, observation: Observation) -> NDArray[np.uint8]:
        """Return what its network is given for an observation, as a picture of shape (S, S, C)."""
        return self._painter.picture(observation.mask)

    @property
    def belief(self) -> Array | None:
        """The belief across gaps that its network was told last, (`belief.SIZE`,); None without one."""
        told = self._policy.inputs.get("belief")
        return None if told is None else told[0]

    def step(self, mask_input: Array) -> tuple[Array, Array | None]:
        """Answer one network input.

        Args:
            mask_input: float32 of shape (C, S, S), already painted and scaled; free to be reused after.

        Returns:
            The action of shape (A,) and the context z of shape (Z,), None without an encoder.
        """
        inputs = self._policy.inputs
        np.copyto(inputs["mask"][0], mask_input)
        target = belief.target_pixels(mask_input, self._mask)
        told = self._past.see(target, self._last_action, self._info.action)
        if "belief" in inputs:
            inputs["belief"] = told.belief[None]
        context = None
        if self._encoder is not None:
            own = np.concatenate((self._encoder.context(), told.response[None]), axis=1)
            inputs["z"] = own if self._imposed is None else self._imposed
            context = inputs["z"][0]
        action, inputs["h"], inputs["c"] = self._policy.run("action", "h_next", "c_next")
        if self._searches:
            yaw = self._past.search_yaw()
            action, self._searching = with_search(action, yaw, self._info.action), bool(yaw)
        if "last_action" in inputs:
            inputs["last_action"] = action
        self._last_action = action[0]
        if self._encoder is not None:
            self._encoder.remember(inputs["mask"], action)
        return action[0], context


class _Network:
    """One ONNX graph and its input arrays, which are kept between runs."""

    def __init__(self, model: bytes, spec: GraphSpec, providers: Sequence[str], *, where: str) -> None:
        self.session = OnnxSession(model, providers, where=where, exact=True)
        self._spec = spec
        self.clear()

    def clear(self) -> None:
        """Set every input to zero: a blank picture, nothing remembered."""
        self.inputs: dict[str, Array] = {
            tensor.name: np.zeros(tensor.shape, np.float32) for tensor in self._spec.inputs
        }

    def run(self, *outputs: str) -> list[Any]:
        """Return the named outputs as new arrays."""
        return self.session.run(outputs, self.inputs)


class _Encoder(Protocol):
    """Makes the context z of the pairs up to the last tick."""

    def reset(self) -> None:
        """Remember nothing but blank pairs."""

    def context(self) -> Array:
        """Return z, shape (1, Z); called once a tick."""

    def remember(self, mask: Array, action: Array) -> None:
        """Take this tick's pair, shapes (1, C, S, S) and (1, A), for the next tick's z."""


def _encoder(bundle: Bundle, providers: Sequence[str]) -> _Encoder | None:
    spec = bundle.manifest.encoder
    if bundle.encoder is None or spec is None:
        return None
    network = _Network(bundle.encoder, spec, providers, where=f"{bundle.folder}/{ENCODER_NAME}")
    return _Streaming(network) if bundle.manifest.interface == "streaming" else _Window(network)


class _Streaming:
    """One pair a tick; the features of the K newest go in and out.

    They are kept less those of a blank pair, so that a history of zeros is one of K blank pairs.
    """

    def __init__(self, network: _Network) -> None:
        self._network = network

    def reset(self) -> None:
        self._network.clear()

    def context(self) -> Array:
        z: Array
        z, self._network.inputs["history"] = self._network.run("z", "history_next")
        return z

    def remember(self, mask: Array, action: Array) -> None:
        np.copyto(self._network.inputs["mask"], mask)
        self._network.inputs["action"] = action


class _Window:
    """K pairs a tick, oldest first."""

    def __init__(self, network: _Network) -> None:
        self._network = network

    def reset(self) -> None:
        self._network.clear()

    def context(self) -> Array:
        (z,) = self._network.run("z")
        return z  # type: ignore[no-any-return]

    def remember(self, mask: Array, action: Array) -> None:
        for name, newest in (("masks", mask), ("actions", action)):
            pairs = self._network.inputs[name][0]
            pairs[:-1] = pairs[1:]
            pairs[-1] = newest[0]


def _check_answers(policy: OnnxPolicy, bundle: Bundle) -> None:
    """Run the golden vectors from reset; raise UsageError at the first answer that is not the golden one."""
    where, golden = f"{bundle.folder}/{GOLDEN_NAME}", bundle.golden
    for tick in range(GOLDEN_TICKS):
        try:
            action, z = policy.step(golden["mask"][tick])
        except Exception as error:
            raise UsageError(f"{bundle.folder}: its networks fail to run: {one_line(error)}") from error
        for name, got in (("action", action), ("z", z), ("belief", policy.belief)):
            if got is None:
                continue
            wanted = golden[name][tick]
            difference = float(np.abs(got - wanted).max()) if got.shape == wanted.shape else math.inf
            if not difference <= GOLDEN_TOLERANCE:  # NaN must not pass
                raise UsageError(
                    f"{where}: the networks' answers differ from those at the export: {name} differs by "
                    f"{difference:.2g} at tick {tick}; at most {GOLDEN_TOLERANCE:g} is allowed"
                )
