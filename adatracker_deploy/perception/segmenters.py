"""Which segmenter a name or a file means."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.errors import UsageError
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
    rate_hz: float = 30.0,
    providers: tuple[str, ...] | None = None,
) -> tuple[Segmenter, str]:
    """Open a segmenter; return it with one line that says what runs where.

    Args:
        name: `TRUTH`, `NOISY`, `EMBEDDED`, or a path to a model.
        prompt: words with commas between them.
        choice: who becomes the target.
        rate_hz: of the camera; only rehearsals ask.
        providers: where models run, by preference; None: the processor, or what a model's sidecar says.

    Raises:
        UsageError: there is no such segmenter, it does not know a word, or its file cannot be used.
    """
    words = words_of(prompt)
    if name == TRUTH:
        return TruthSegmenter(), "the simulated camera's truth"
    if name == NOISY:
        from adatracker_deploy.perception.noisy_truth import NoisyTruth  # the sitl extra's world

        return NoisyTruth(
            "embedded", rate_hz
        ), "the simulated camera's truth, spoilt like the embedded segmenter's"
    if name == EMBEDDED:
        return _embedded(words, choice, providers or ("cpu",))
    if not name.endswith(_FILES):
        raise UsageError(f"segmenter {name!r}: expected {KNOWN}")
    return _from_file(Path(name), words, choice, providers)


def _embedded(words: tuple[str, ...], choice: Choice, providers: tuple[str, ...]) -> tuple[Segmenter, str]:
    from adatracker_deploy.models import shipped
    from adatracker_deploy.perception.models.nanodet import NanoDet
    from adatracker_deploy.perception.models.selfie import SelfieMasks

    detector = NanoDet(shipped("nanodet_g_int8.onnx"), words, providers=providers)
    heads = SelfieMasks(shipped("selfie_segmentation.onnx"), providers=providers)
    lines = "; ".join(str(network) for network in (*detector.networks, *heads.networks))
    return TargetSegmenter(detector, heads, choice), lines


def _from_file(
    path: Path, words: tuple[str, ...], choice: Choice, providers: tuple[str, ...] | None
) -> tuple[Segmenter, str]:
    from adatracker_deploy.models import shipped
    from adatracker_deploy.perception.models.catalogue import open_model
    from adatracker_deploy.perception.models.sam2 import Sam2Propagator
    from adatracker_deploy.perception.models.selfie import SelfieMasks

    model = open_model(path, words, providers)
    if isinstance(model, Sam2Propagator):
        raise UsageError(
            f"segmenter {path}: follows a mask and finds nobody by itself: give a detector's file"
        )
    lines = "; ".join(map(str, model.networks))
    return TargetSegmenter(model, SelfieMasks(shipped("selfie_segmentation.onnx")), choice), lines
