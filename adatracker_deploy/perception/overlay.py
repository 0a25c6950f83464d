"""Draws perception's results over an image: masks, box, state, network input and action. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.mask_png import PALETTE
from adatracker_deploy.core.messages import MaskClass, TargetState

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from adatracker_deploy.core.messages import Box, ClassMask, Observation

Image = NDArray[np.uint8]
"""RGB, shape (H, W, 3)."""
Colour = tuple[int, int, int]

LEAST_HEIGHT_PX, LARGEST_HEIGHT_PX, LARGEST_WIDTH_PX = 360, 720, 1280
"""Smaller pictures are enlarged, for the text has to fit; larger ones are reduced."""
TINT = {MaskClass.TARGET: 0.45, MaskClass.PERSON: 0.4, MaskClass.OBSTACLE: 0.4}
"""Opacity of each class over the picture."""
SHADE = 0.3
"""Brightness that a panel leaves of the picture behind it, so that its text can be read on any."""

WHITE = (245, 246, 248)
FAINT = (170, 175, 184)
STATE_COLOURS: dict[TargetState | None, Colour] = {
    TargetState.TRACKED: PALETTE[MaskClass.TARGET],
    TargetState.REACQUIRED: (70, 200, 235),
    TargetState.COASTING: (250, 205, 60),
    TargetState.LOST: (240, 85, 75),
    TargetState.CHOOSING: (90, 150, 250),
    None: FAINT,
}
_MOVES = {
    "forward": ("forward", "back"),
    "lateral": ("left", "right"),
    "vertical": ("up", "down"),
    "yaw": ("turn left", "turn right"),
}
"""The names of positive and negative values (REP 103)."""
_FONT = cv2.FONT_HERSHEY_SIMPLEX


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """A policy's output, for display."""

    moves: Mapping[str, float] | None
    """By axis, in [-1, 1] of the robot's limit, positive as in REP 103; None: nothing was asked of it."""
    sees: Image | None = None
    """Its network's input, shape (S, S, 1) or (S, S, 3); None where it has no network."""


def overlay(
    rgb: Image, observation: Observation, when: str, drive: Drive | None = None, *, stale: bool = False
) -> Image:
    """Draw one frame as a new picture, of the size that `shown_size` gives.

    Args:
        rgb: the frame's picture.
        observation: what perception made of it.
        when: its time or age, in words.
        drive: the policy's command; None without one.
        stale: it is too old to be acted on: where the target is now is not known.
    """
    width, height = shown_size(rgb.shape[1], rgb.shape[0])
    enlarged = height > rgb.shape[0]
    image: Image = np.asarray(
        cv2.resize(rgb, (width, height), interpolation=cv2.INTER_CUBIC if enlarged else cv2.INTER_AREA)
    )
    _tint(image, observation.mask)
    pen = _Pen(image)
    colour = FAINT if stale else STATE_COLOURS[_state(observation)]
    if observation.box is not None:
        pen.box(observation.box, colour)
    pen.status("stale" if stale else _words(observation), f"frame {observation.seq}   {when}", colour)
    if drive is not None:
        pen.moves(drive.moves)
        if drive.sees is not None:
            pen.inset(drive.sees)
    return image


def shown_size(width: int, height: int) -> tuple[int, int]:
    """Return the width and height, px, at which a picture is shown: both even, as video wants them."""
    scale = min(max(LEAST_HEIGHT_PX / height, 1.0), LARGEST_HEIGHT_PX / height, LARGEST_WIDTH_PX / width)
    return max(2, round(width * scale / 2) * 2), max(2, round(height * scale / 2) * 2)


def _state(observation: Observation) -> TargetState | None:
    if observation.target is None and observation.box is not None:
        return TargetState.TRACKED  # a rehearsal knows who it is
    return observation.target


def _words(observation: Observation) -> str:
    state = _state(observation)
    if state is None:
        return "no target yet"
    return state.value if observation.box is None else f"{state.value} {observation.confidence:.2f}"


def _tint(image: Image, mask: ClassMask) -> None:
    """Paint each class over the picture, with a thin line around it; masks are enlarged smoothly."""
    height, width = image.shape[:2]
    for value, strength in TINT.items():
        found = mask == value
        if not found.any():
            continue
        soft = cv2.resize(found.astype(np.uint8) * 255, (width, height), interpolation=cv2.INTER_LINEAR)
        _, inside = cv2.threshold(soft, 127, 255, cv2.THRESH_BINARY)
        left, top, across, down = cv2.boundingRect(inside)
        area = image[top : top + down, left : left + across]
        colours = np.full_like(area, PALETTE[value])
        painted = cv2.addWeighted(area, 1 - strength, colours, strength, 0)
        cv2.copyTo(painted, inside[top : top + down, left : left + across], area)
        outlines, _ = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        cv2.drawContours(image, outlines, -1, PALETTE[value], 1, cv2.LINE_AA)


class _Pen:
    """Draws on one picture, in sizes that go with it."""

    def __init__(self, image: Image) -> None:
        self._image = image
        self._height, self._width = image.shape[:2]
        self._unit = self._height / LEAST_HEIGHT_PX
        """1 at the smallest height; text grows with the square root of it."""
        self._scale = 0.45 * self._unit**0.5
        self._line = round(18 * self._unit**0.5)
        self._gap = round(8 * self._unit**0.5)

    def box(self, box: Box, colour: Colour) -> None:
        """Outline the target: a thin line on a darker one, seen before any background."""
        corners = [
            (
                round((box.cx + side * box.w / 2) * self._width),
                round((box.cy + side * box.h / 2) * self._height),
            )
            for side in (-1, 1)
        ]
        cv2.rectangle(self._image, *corners, (20, 22, 26), 3, cv2.LINE_AA)
        cv2.rectangle(self._image, *corners, colour, 1, cv2.LINE_AA)

    def status(self, state: str, frame: str, colour: Colour) -> None:
        """Say at the top left how it stands with the target, and which frame this is."""
        gap, line = self._gap, self._line
        width = max(self._text_width(state) + line, self._text_width(frame))
        self._panel(gap, gap, width + 2 * gap, 2 * line + gap)
        dot = max(3, line // 4)
        cv2.circle(self._image, (2 * gap + dot, gap + line // 2 + gap // 2), dot, colour, -1, cv2.LINE_AA)
        self._write(state, 2 * gap + line, gap + line - gap // 4, WHITE)
        self._write(frame, 2 * gap, gap + 2 * line - gap // 4, FAINT)

    def moves(self, moves: Mapping[str, float] | None) -> None:
        """Show at the bottom left where the policy drives: an arrow, up is forward, and numbers."""
        gap, line = self._gap, self._line
        lines = _move_lines(moves)
        dial = 4 * line
        width = dial + max(map(self._text_width, ["turn right 0.00", *lines])) + 3 * gap
        top = self._height - gap - dial - gap
        self._panel(gap, top, width, dial + gap)
        centre = (gap + gap // 2 + dial // 2, top + gap // 2 + dial // 2)
        radius = dial // 2 - gap // 2
        cv2.circle(self._image, centre, radius, FAINT, 1, cv2.LINE_AA)
        cv2.circle(self._image, centre, 2, FAINT, -1, cv2.LINE_AA)
        if moves is not None:
            right = -moves.get("yaw", moves.get("lateral", 0.0))
            up = moves.get("forward", moves.get("vertical", 0.0))
            tip = _inside(right, up)
            end = (round(centre[0] + tip[0] * radius), round(centre[1] - tip[1] * radius))
            if end != centre:
                cv2.arrowedLine(self._image, centre, end, WHITE, 2, cv2.LINE_AA, tipLength=0.25)
        first = top + (dial + gap - len(lines) * line) // 2
        for number, text in enumerate(lines, start=1):
            self._write(text, dial + 2 * gap, first + number * line - gap // 2, WHITE)

    def inset(self, sees: Image) -> None:
        """Show the network's input at the bottom right, pixel by pixel."""
        times = max(1, round(self._height * 0.26) // sees.shape[0])
        rgb = np.broadcast_to(sees, (*sees.shape[:2], 3)).repeat(times, axis=0).repeat(times, axis=1)
        height, width = rgb.shape[:2]
        gap, line = self._gap, self._line
        top, left = self._height - gap - height, self._width - gap - width
        if top < line + 2 * gap or left < self._width // 2:
            return  # no room
        self._panel(left - 1, top - line, width + 2, line)
        self._image[top : top + height, left : left + width] = rgb
        cv2.rectangle(self._image, (left - 1, top - 1), (left + width, top + height), FAINT, 1)
        self._write("network", left + gap // 2, top - gap // 2, WHITE)

    def _panel(self, left: int, top: int, width: int, height: int) -> None:
        area = self._image[max(top, 0) : max(top + height, 0), max(left, 0) : max(left + width, 0)]
        np.copyto(area, (area * SHADE).astype(np.uint8))

    def _write(self, text: str, left: int, bottom: int, colour: Colour) -> None:
        cv2.putText(self._image, text, (left, bottom), _FONT, self._scale, colour, 1, cv2.LINE_AA)

    def _text_width(self, text: str) -> int:
        (width, _), _ = cv2.getTextSize(text, _FONT, self._scale, 1)
        return int(width)


def _move_lines(moves: Mapping[str, float] | None) -> Sequence[str]:
    if moves is None:
        return ["no action"]
    return [f"{_MOVES[axis][value < 0]} {abs(value):.2f}" for axis, value in moves.items()]


def _inside(right: float, up: float) -> tuple[float, float]:
    """Return (right, up), or where its direction leaves the unit disc; the centre for what is not finite."""
    length = math.hypot(right, up)
    if not math.isfinite(length):
        return 0.0, 0.0
    return right / max(length, 1.0), up / max(length, 1.0)
