"""Settings of a training run: method, variants, length. Part of every snapshot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

from adatracker_deploy.config.schema import Range
from adatracker_deploy.learning.networks import AdaTrackerConfig

Method = Literal["dagger", "cloning", "awr", "td3", "cql_sac"]
Variant = Literal[
    "no-identification",
    "no-dynamics",
    "no-consistency",
    "no-encoder",
    "no-lstm",
    "no-last-action",
    "no-search",
]

BURN_IN = 8
"""A sequence that begins amid its episode has no memory of what was before: its first steps do not count."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainSettings:
    """One run; equal settings and data give equal weights, on the CPU to the bit."""

    recipe: str
    """Name or path, or names joined by ``+``; what visited episodes are drawn from."""
    method: Method = "dagger"
    variants: tuple[Variant, ...] = ()
    """Parts left out: the identification task (reward, height and our dynamics head), that head alone, the
    consistency task, the encoder, the policy's LSTM, the last action as an input of the policy, the search
    labels of DAgger (`data/search_labels.py`)."""
    init: str | None = None
    """Folder of another run, or a bundle, whose weights this one begins with, heads and critics aside."""
    rate: Annotated[float, Range(1e-7, 1e-1)] | None = None
    """Learning rate at the start, instead of the method's own."""
    seed: Annotated[int, Range(0, 1 << 31)] = 0
    updates: Annotated[int, Range(1, 10_000_000)] = 8000
    rounds: Annotated[int, Range(0, 100)] = 3
    """Rounds of visits, after a first part on the given data; updates are spread evenly over all parts."""
    round_steps: Annotated[int, Range(1, 100_000_000)] = 100_000
    """Steps that are visited for each round."""
    batch: Annotated[int, Range(1, 4096)] = 16
    length: Annotated[int, Range(2, 1000)] = 48
    """Length of a sequence, steps."""
    critic_updates: Annotated[int, Range(1, 1_000_000)] = 3000
    """Updates of `awr`'s and `td3`'s critics, before the policy's first."""
    conservative: Annotated[float, Range(0, 100)] = 0.0
    """Weight of the conservative term in the losses of `awr`'s critics."""
    logs: bool = False
    """The data are logged trials, not shards; `run.train` finds out."""
    front: Literal["cnn", "pooled"] = "cnn"
    """What looks at a mask (`AdaTrackerConfig.front`)."""
    belief: bool = False
    """The policy is told the belief across gaps (`policy.belief`)."""
    response: bool = False
    """The policy is told the response of the body (`policy.response`), as part of its context."""
    late: bool = False
    """`td3` makes a driver for bodies that obey late (`drivers.Memories`), and does not hold those more."""
    bfloat16: bool = False
    """Pays where the processor multiplies such numbers itself (AMX, a GPU); elsewhere it is slower."""

    def config(self) -> AdaTrackerConfig:
        """Return the networks' sizes."""
        config = AdaTrackerConfig(
            last_action="no-last-action" not in self.variants,
            lstm="no-lstm" not in self.variants,
            front=self.front,
            belief=self.belief,
            response=self.response,
        )
        return replace(config, history=0, context=0) if "no-encoder" in self.variants else config
