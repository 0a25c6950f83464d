"""The page of a viewing: what perception sees, without any robot."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import cv2

from adatracker_deploy.app.trial_page import became, unchoosable
from adatracker_deploy.core.mask_png import encode_mask
from adatracker_deploy.page.feed import Feed, Pictures
from adatracker_deploy.page.server import PageServer
from adatracker_deploy.perception.target.choice import BY_CLICK

if TYPE_CHECKING:
    from collections.abc import Mapping

    from adatracker_deploy.app.view_run import Viewed
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.messages import Frame
    from adatracker_deploy.page.address import Address
    from adatracker_deploy.perception.segmenter import Segmenter

_JPEG_QUALITY = 90
_FIELDS = {"forward": "vx", "lateral": "vy", "vertical": "vz", "yaw": "yaw_rate"}


class ViewPage:
    """Shows processed frames, and brings the operator's clicks.

    Args:
        address: where.
        camera: as it was named.
        policy: likewise.
        target: how the target is chosen.
        segmenter: finds it.

    Raises:
        UsageError: the port is in use.
    """

    def __init__(self, address: Address, camera: str, policy: str, target: str, segmenter: Segmenter) -> None:
        about: dict[str, Any] = {
            "title": camera,
            "what": f"policy: {policy}; no robot",
            "unit": "share",
            "full": dict.fromkeys(_FIELDS.values(), 1.0),
            "stop": False,
            "by_click": target == BY_CLICK,
        }
        self.url = address.url
        self._feed = Feed(about)
        self._server = PageServer(
            address, self._feed, option="--port", unchoosable=unchoosable(segmenter.needs_truth)
        )
        self._told: int | None = None

    def with_click(self, frame: Frame) -> Frame:
        """Return a frame with the operator's last click since the frame before."""
        clicks = self._server.clicks()
        return replace(frame, click=clicks[-1]) if clicks else frame

    def show(self, viewed: Viewed, moves: Mapping[str, float] | None, clock: Clock | None) -> None:
        """Show a processed frame, and what became of a click.

        Args:
            viewed: the frame.
            moves: where the policy would go, by axis, in shares of a robot's limits.
            clock: the run's, for the age of a live frame; None for a video.
        """
        frame, observation = viewed.frame, viewed.observation
        box, pick = observation.box, observation.pick
        state = observation.target.value if observation.target else "seen" if box else "no target yet"
        self._feed.show(
            {
                "phase": "viewing",
                "seq": frame.seq,
                "target": state,
                "searching": viewed.action is not None and viewed.action.searching,
                "confidence": observation.confidence,
                "box": None if box is None else (box.cx, box.cy, box.w, box.h),
                "wish": {_FIELDS[axis]: value for axis, value in (moves or {}).items()},
                "ms": {
                    "perception and policy": viewed.took_ms,
                    "age of the picture": (clock.now_ns() - frame.t_ns) / 1e6 if clock else None,
                },
            },
            self._pictures(viewed) if self._feed.watched else None,
        )
        if pick is not None and pick.click.number != self._told:
            self._told = pick.click.number
            self._feed.say("warning" if pick.box is None else "info", became(pick))

    def close(self) -> None:
        """End every stream and free the port."""
        self._server.close()

    def _pictures(self, viewed: Viewed) -> Pictures:
        jpeg = viewed.frame.jpeg
        if jpeg is None:
            bgr = cv2.cvtColor(viewed.frame.rgb, cv2.COLOR_RGB2BGR)
            jpeg = bytes(cv2.imencode(".jpg", bgr, (cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY))[1])
        return Pictures(jpeg, encode_mask(viewed.observation.mask))
