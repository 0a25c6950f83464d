"""Opens a segmenter by name or file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.segmenter import TruthSegmenter
from adatracker_deploy.perception.target_segmenter import PERSON, TargetSegmenter

if TYPE_CHECKING:
    from adatracker_deploy.perception.segmenter import Segmenter
    from adatracker_deploy.perception.target.choice import Choice

TRUTH = "truth"
NOISY = "noisy"
EMBEDDED = "embedded"
OF_REHEARSALS = (TRUTH, NOISY)
KNOWN = f"{EMBEDDED}, a model's .onnx or .yaml file, or in rehearsals {' or '.join(OF_REHEARSALS)}"
_FILES = (".onnx", ".yaml", ".yml")


def words_of(prompt: str) -> tuple[str, ...]:
    """Return the words of a prompt, as in ``person, chair``.

    Raises:
        UsageError: there are none, or `person` is not among them.
    """
    words = tuple(dict.fromkeys(" ".join(word.lower().split()) for word in prompt.split(",") if word.strip()))
    if PERSON not in words:
        raise UsageError(
            f"prompt {prompt!r}: expected words with {PERSON!r} among them, as in 'person, obstacles'"
        )
    return words


def open_segmenter(
    name: str,
    prompt: str,
    choice: Choice,
    *,
    propagator: Path | None = None,
    rate_hz: float = 30.0,
    providers: tuple[str, ...] | None = None,
) -> tuple[Segmenter, str]:
    """Open a segmenter; return it with one line that says what runs where.

    Args:
        name: `TRUTH`, `NOISY`, `EMBEDDED`, or a path to a model.
        prompt: words with commas between them.
        choice: who becomes the target.
        propagator: the .yaml of one that follows the target's mask.
        rate_hz: of the camera; only rehearsals ask.
        providers: where models run, by preference; None: the processor, or what a model's sidecar says.

    Raises:
        UsageError: there is no such segmenter, it does not know a word, or its file cannot be used.
    """
    words = words_of(prompt)
    if propagator and name in OF_REHEARSALS:
        raise UsageError(
            f"--propagator follows people in pictures, which --segmenter {name} does not look at"
        )
    if name == TRUTH:
        return TruthSegmenter(), "the simulated camera's truth"
    if name == NOISY:
        from adatracker_deploy.perception.noisy_truth import NoisyTruth  # needs the world extra

        return NoisyTruth(
            "embedded", rate_hz
        ), "the simulated camera's truth, augmented like the embedded segmenter's"
    if name != EMBEDDED and not name.endswith(_FILES):
        raise UsageError(f"segmenter {name!r}: expected {KNOWN}")
    return _of_pictures(name, words, choice, propagator, providers)


def _of_pictures(
    name: str,
    words: tuple[str, ...],
    choice: Choice,
    propagator: Path | None,
    providers: tuple[str, ...] | None,
) -> tuple[Segmenter, str]:
    from adatracker_deploy.perception.models.catalogue import open_model
    from adatracker_deploy.perception.models.grounding_dino import GroundingDino
    from adatracker_deploy.perception.models.nanodet import SCORE, NanoDet
    from adatracker_deploy.perception.models.pose import PoseMasks
    from adatracker_deploy.perception.models.sam2 import Sam2Propagator
    from adatracker_deploy.perception.models.selfie import SelfieMasks
    from adatracker_deploy.perception.target.first_sight import LEAST_SCORE
    from adatracker_deploy.perception.weights import shipped

    where = providers or ("cpu",)
    detector = (
        NanoDet(shipped("nanodet_g_int8.onnx"), words, score=LEAST_SCORE, providers=where)
        if name == EMBEDDED
        else open_model(Path(name), words, providers)
    )
    if isinstance(detector, Sam2Propagator):
        raise UsageError(
            f"segmenter {name}: follows a mask and does not detect people: give it as --propagator"
        )
    others = SelfieMasks(shipped("selfie_segmentation.onnx"), providers=where)
    heads = PoseMasks(shipped("pose_landmark_lite.onnx"), others, providers=where)
    follower = None if propagator is None else open_model(propagator, (), providers)
    if not (follower is None or isinstance(follower, Sam2Propagator)):
        raise UsageError(
            f"propagator {propagator}: detects people but does not follow a mask: expected kind sam2"
        )
    parts = (detector, heads) if follower is None else (detector, heads, follower)
    segmenter = TargetSegmenter(
        detector,
        heads,
        choice,
        follower,
        least_score=SCORE if name == EMBEDDED else 0.0,
        key_frames=follower is not None and isinstance(detector, GroundingDino),
        witness=heads,
    )
    return segmenter, "; ".join(str(network) for part in parts for network in part.networks)
