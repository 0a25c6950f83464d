"""A policy small enough to compute by hand: the same arithmetic once as ONNX graphs and once in numpy.

pair features: tanh(mask W + action V + b); context: tanh(K features U); state: tanh(mask P + z Q + h R).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import onnx
from onnx import numpy_helper, parser

from adatracker_deploy.policy.base import ActionAxis
from adatracker_deploy.policy.bundle import Manifest, write_bundle
from adatracker_deploy.policy.golden import GOLDEN_TICKS
from adatracker_deploy.policy.manifest import MaskSpec, Palette, graph_specs

SIZE, ACTIONS, HIDDEN, CONTEXT, HISTORY, FEATURES, OPSET = 8, 2, 4, 3, 5, 6, 18

POLICY = """
policy (float[1,3,8,8] mask, {z} float[1,1,4] h, float[1,1,4] c)
    => (float[1,2] action, float[1,1,4] h_next, float[1,1,4] c_next) {{
    flat = Flatten(mask)
    seen = MatMul(flat, P)
    {known}
    kept = MatMul(h, R)
    sum = Add(known, kept)
    h_next = Tanh(sum)
    c_next = Add(c, h_next)
    wide = MatMul(h_next, M)
    narrow = Squeeze(wide, first)
    action = Tanh(narrow)
}}
"""
WITH_CONTEXT = "told = MatMul(z, Q)  known = Add(seen, told)"
STREAMING = """
encoder (float[1,3,8,8] mask, float[1,2] action, float[1,5,6] history)
    => (float[1,3] z, float[1,5,6] history_next) {
    flat = Flatten(mask)
    seen = MatMul(flat, W)
    done = MatMul(action, V)
    both = Add(seen, done)
    biased = Add(both, b)
    pair = Tanh(biased)
    blank = Tanh(b)
    news = Sub(pair, blank)
    newest = Unsqueeze(news, first)
    older = Slice(history, one, end, one)
    history_next = Concat<axis = 1>(older, newest)
    whole = Add(history_next, blank)
    features = Flatten(whole)
    mixed = MatMul(features, U)
    z = Tanh(mixed)
}
"""
WINDOW = """
encoder (float[1,5,3,8,8] masks, float[1,5,2] actions) => (float[1,3] z) {
    flat = Reshape(masks, rows)
    seen = MatMul(flat, W)
    done = MatMul(actions, V)
    both = Add(seen, done)
    biased = Add(both, b)
    pairs = Tanh(biased)
    features = Flatten(pairs)
    mixed = MatMul(features, U)
    z = Tanh(mixed)
}
"""


def weights():
    rng = np.random.default_rng(7)
    pixels = 3 * SIZE * SIZE
    shapes = {
        "W": (pixels, FEATURES),
        "V": (ACTIONS, FEATURES),
        "b": (FEATURES,),
        "U": (HISTORY * FEATURES, CONTEXT),
        "P": (pixels, HIDDEN),
        "Q": (CONTEXT, HIDDEN),
        "R": (HIDDEN, HIDDEN),
        "M": (HIDDEN, ACTIONS),
    }
    small = {"W": 1e-3, "P": 1e-3, "R": 0.3, "Q": 0.5, "V": 0.5}  # feedback damped: rounding must not grow
    return {
        name: (rng.normal(size=shape) * small.get(name, 1.0)).astype(np.float32)
        for name, shape in shapes.items()
    }


W = weights()
INDICES = {"first": [0], "one": [1], "end": [HISTORY], "rows": [1, HISTORY, 3 * SIZE * SIZE]}
CONSTANTS = W | {name: np.array(value, np.int64) for name, value in INDICES.items()}


def model(text):
    """Return the ONNX model of a graph's text, with the weights that it names inside."""
    graph = parser.parse_graph(text)
    used = {name for node in graph.node for name in node.input}
    graph.initializer.extend(
        numpy_helper.from_array(value, name) for name, value in CONSTANTS.items() if name in used
    )
    return onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", OPSET)], ir_version=8)


def policy_model(interface="streaming"):
    if interface == "none":
        return model(POLICY.format(z="", known="known = Identity(seen)"))
    return model(POLICY.format(z="float[1,3] z,", known=WITH_CONTEXT))


def encoder_model(interface="streaming"):
    return model(STREAMING if interface == "streaming" else WINDOW)


def answers(masks, interface="streaming"):
    """Compute actions (T, A) and contexts (T, Z) in numpy, from the definition: pairs t-K to t-1."""
    rows = masks.reshape(len(masks), -1)
    pairs = [(np.zeros_like(rows[0]), np.zeros(ACTIONS, np.float32))] * HISTORY
    h, actions, contexts = np.zeros(HIDDEN, np.float32), [], []
    for row in rows:
        features = [np.tanh(mask @ W["W"] + action @ W["V"] + W["b"]) for mask, action in pairs[-HISTORY:]]
        z = np.tanh(np.concatenate(features) @ W["U"])
        told = 0 if interface == "none" else z @ W["Q"]
        h = np.tanh(row @ W["P"] + told + h @ W["R"])
        action = np.tanh(h @ W["M"])
        pairs.append((row, action))
        actions.append(action)
        contexts.append(z)
    return np.array(actions), np.array(contexts)


def masks(ticks=GOLDEN_TICKS, seed=0):
    values = np.random.default_rng(seed).choice([0.0, 80.0, 255.0], size=(ticks, 3, SIZE, SIZE))
    return values.astype(np.float32)


def golden(interface="streaming"):
    action, z = answers(masks(), interface)
    made = {"mask": masks(), "action": action}
    return made if interface == "none" else made | {"z": z}


MASK = MaskSpec(
    size=SIZE,
    channels=3,
    draw_size=16,
    scale=1.0,
    palette=Palette(background=(0, 0, 0), target=(255, 255, 255), person="random", obstacle="random"),
)


def manifest(interface="streaming", **changes):
    remembers = interface != "none"
    encoder, policy = graph_specs(
        interface,
        mask=MASK,
        actions=ACTIONS,
        hidden=HIDDEN,
        context=CONTEXT,
        history=HISTORY,
        features=FEATURES,
    )
    whole = Manifest(
        format=1,
        name="tiny",
        interface=interface,
        opset=OPSET,
        history=HISTORY if remembers else 0,
        context=CONTEXT if remembers else 0,
        mask=MASK,
        action=(ActionAxis(axis="yaw", sign=-1), ActionAxis(axis="forward")),
        rate_hz=10.0,
        encoder=encoder,
        policy=policy,
        training="random weights\nfor tests",
        licence="CC0-1.0",
    )
    return replace(whole, **changes)


@dataclass
class Parts:
    """The arguments of `write_bundle`; a test breaks one of them."""

    interface: str = "streaming"
    manifest: Manifest = field(default=None)
    encoder: onnx.ModelProto | None = None
    policy: onnx.ModelProto = None
    golden: dict = None

    def __post_init__(self):
        self.manifest = manifest(self.interface)
        self.encoder = None if self.interface == "none" else encoder_model(self.interface)
        self.policy = policy_model(self.interface)
        self.golden = golden(self.interface)

    def write(self, folder):
        encoder = self.encoder.SerializeToString() if self.encoder is not None else None
        return write_bundle(
            folder,
            self.manifest,
            encoder=encoder,
            policy=self.policy.SerializeToString(),
            golden=self.golden,
        )
