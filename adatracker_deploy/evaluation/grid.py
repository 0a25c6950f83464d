"""The evaluation grid: the paper's 16 bodies, several episodes each, the same for every policy."""

from __future__ import annotations

from dataclasses import dataclass

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.evaluation.eyes import check_eyes
from adatracker_deploy.evaluation.play import Episode
from adatracker_deploy.learning.conditions import HEIGHTS_M, TARGET_SPEEDS_M_S, condition_named, make_cell
from adatracker_deploy.learning.episode_spec import RATE_HZ
from adatracker_deploy.learning.seeds import FIRST_EVALUATION
from adatracker_deploy.perception.segmenters import TRUTH
from adatracker_deploy.policy.catalogue import load_policy
from adatracker_deploy.policy.onnx_policy import OnnxPolicy
from adatracker_deploy.policy.remote import RemotePolicy
from adatracker_deploy.sim.worlds import check_pictures, check_scene

PAPER_SCENE, PAPER_STEPS = "simple_room", 500
"""Scene and episode length of the paper's per-embodiment results."""
EYES_ASPECT = 0.75
"""Of the pictures that a segmenter is shown: 640 x 480, as most cameras' are."""
MOST_EPISODES = 10_000
"""Episodes of a cell have seeds of their own, of which each cell has so many."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One of the paper's embodiments."""

    height_m: float
    """Height of the camera."""
    target_speed_m_s: float
    """The tracker's own limit follows from it, see `learning.conditions`."""


CELLS = tuple(Cell(height_m, speed_m_s) for height_m in HEIGHTS_M for speed_m_s in TARGET_SPEEDS_M_S)


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """The policies, scenes and conditions of a comparison.

    Raises:
        UsageError: there is no such condition, scene or policy, a policy is named twice, or a number is out
            of range.
    """

    policies: tuple[str, ...]
    """As `load_policy` takes them."""
    condition: str = "clean"
    scene: str = PAPER_SCENE
    episodes: int = 20
    """A cell."""
    seed: int = 0
    """Seed of the whole grid; another one gives other episodes, all reserved for evaluation."""
    steps: int = PAPER_STEPS
    """The horizon."""
    segmenter: str = TRUTH
    """``truth``, whose masks the condition spoils; or one that is shown pictures, as `open_segmenter` takes
    it, and spoils its own."""
    aspect: float | None = None
    """Height of pictures and masks as a share of their width; None: square for the truth's masks, as the
    paper's are, and `EYES_ASPECT` for a segmenter."""

    def __post_init__(self) -> None:
        condition_named(self.condition)
        check_scene(self.scene)
        if self.segmenter != TRUTH:
            check_pictures(self.scene)
            check_eyes(self.segmenter)
        for name, value, low, high in (
            ("episodes", self.episodes, 1, MOST_EPISODES),
            ("seed", self.seed, 0, 1_000_000),
            ("steps", self.steps, 1, 100_000),
            ("aspect", self.shown_aspect, 0.25, 1),
        ):
            if not low <= value <= high:
                raise UsageError(f"{name}: {value} is out of range [{low}, {high}]")
        twice = next((name for name in self.policies if self.policies.count(name) > 1), None)
        if twice is not None:
            raise UsageError(f"policy {twice!r} is named twice")

    @property
    def is_the_papers(self) -> bool:
        """Scene, horizon and masks are those of the paper's table."""
        asked = (self.scene, self.steps, self.segmenter, self.shown_aspect)
        return asked == (PAPER_SCENE, PAPER_STEPS, TRUTH, 1.0)

    @property
    def shown_aspect(self) -> float:
        """Return the aspect of pictures and masks."""
        if self.aspect is not None:
            return self.aspect
        return 1.0 if self.segmenter == TRUTH else EYES_ASPECT

    def plan(self) -> list[Episode]:
        """Return all episodes, one of every cell by every policy after the other.

        So a run that is cut short has as many of each, give or take one.
        """
        return [
            Episode(policy=policy, spec=spec, steps=self.steps, segmenter=self.segmenter)
            for number in range(self.episodes)
            for index, cell in enumerate(CELLS)
            for spec in [
                make_cell(
                    self.condition,
                    cell.height_m,
                    cell.target_speed_m_s,
                    self._episode_seed(index, number),
                    scene=self.scene,
                    aspect=self.shown_aspect,
                )
            ]
            for policy in self.policies
        ]

    def _episode_seed(self, cell: int, number: int) -> int:
        """Return a seed that no other cell or run has, and that does not depend on how many are asked for."""
        return FIRST_EVALUATION + (self.seed * len(CELLS) + cell) * MOST_EPISODES + number


def policy_labels(policies: tuple[str, ...]) -> dict[str, str]:
    """Return how each policy is called in tables: by its own name where no other has that, else as given.

    Raises:
        UsageError: a policy does not exist, its bundle is refused, or it was trained at another rate.
    """
    names = {policy: _checked_name(policy) for policy in policies}
    own = list(names.values())
    return {policy: name if own.count(name) == 1 else policy for policy, name in names.items()}


def _checked_name(policy: str) -> str:
    loaded = load_policy(policy)
    # A network has learnt what one step brings about; the PID reads the time and takes any rate.
    if isinstance(loaded, OnnxPolicy | RemotePolicy) and loaded.info.rate_hz != RATE_HZ:
        raise UsageError(
            f"policy {policy!r} was trained at {loaded.info.rate_hz:g} Hz; episodes here have {RATE_HZ:g} Hz"
        )
    return loaded.info.name
