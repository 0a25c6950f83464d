"""Perception on real footage: people found, one person kept, and how long it takes.

python benchmarks/perception.py --data DIR [--detection] [--identity [--jitter SEEDS] [--side PX]] [--noise]
    [--speed] [--memory FRAMES]

DIR holds ``video/vtest.avi`` (PETS09-S2L1, 795 frames, 7 a second), its MOT15 ground truth as
``boxes/mot15-PETS09-S2L1/gt/gt.txt``, and other clips under ``video/``.

* detection: every ground-truth box of every frame is matched with one detection, best overlaps first; a match
  has IoU > 0.5.
* identity: a run for each of the 19 people. It begins in the first frame in which a detection overlaps the
  person's box by half; from there to the person's last frame the lock is told nothing more. Success: the
  share of the person's frames in which the lock's box overlaps theirs by more than half. Wrong: the share in
  which it overlaps somebody else's by more than half and not theirs. EL: the share before 20 frames in a row
  without success. The box is the one that the robot is given: what was found or, of a target that was missed
  for 0.3 s at most, where it is expected. The constants of the lock were chosen on this very footage: no
  other was at hand. With --jitter as many runs more, in which 3 % of the boxes are dropped and each side of
  the others is off by 2 % of the box's size (standard deviation). --side is the detector's input.
* noise: the same runs in the terms of `sim/noise.py`: how often and for how long the target has no box,
  and false people with a score of 0.5 or more.
* speed: from a decoded frame of 640x480 to the observation, frame by frame, as the embedded segmenter is used
  (the second of two people who are cut out has the other core); and each model alone.
* memory: so many frames through camera, perception thread and embedded segmenter, clip after clip, each
  opened anew as trials do it; resident memory, threads and open files on the way. Only when asked for.
"""

from __future__ import annotations

import argparse
import itertools
import os
import threading
import time
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from adatracker_deploy.core.camera import FilmOverError
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.messages import Frame
from adatracker_deploy.perception.boxes import overlap
from adatracker_deploy.perception.capture import Capture
from adatracker_deploy.perception.models.nanodet import SIDE, NanoDet
from adatracker_deploy.perception.models.pose import PoseMasks
from adatracker_deploy.perception.models.selfie import SelfieMasks
from adatracker_deploy.perception.pipeline import Perception
from adatracker_deploy.perception.segmenters import EMBEDDED, open_segmenter
from adatracker_deploy.perception.sources import FileCamera
from adatracker_deploy.perception.target.appearance import appearances
from adatracker_deploy.perception.target.choice import Choice
from adatracker_deploy.perception.target.lock import TargetLock
from adatracker_deploy.perception.target.motion import CameraMotion
from adatracker_deploy.perception.target_segmenter import TargetSegmenter
from adatracker_deploy.perception.weights import shipped

RATE_HZ = 7.0
"""Frame rate of PETS09-S2L1; the file says 10."""
DROPPED, OFF = 0.03, 0.02
MATCH = 0.5
LOST_FRAMES = 20
SURE_SCORE = 0.5
"""Least score of the false people that are counted."""
FALSE = 0.3
"""A box that overlaps nobody by more is of no person."""
THRESHOLDS = (0.35, 0.4, 0.45, 0.48, 0.5, 0.52, 0.55)
TOLD = 20
"""Lines of the memory table."""
LOOK_HZ = 200.0
"""Rate at which the perception thread polls for a frame, as in a trial."""


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    for part in ("detection", "identity", "noise", "speed"):
        parser.add_argument(f"--{part}", action="store_true")
    parser.add_argument("--jitter", type=int, default=0, metavar="SEEDS")
    parser.add_argument("--side", type=int, default=SIDE, metavar="PX")
    parser.add_argument("--memory", type=int, default=0, metavar="FRAMES")
    arguments = parser.parse_args()
    asked = arguments.detection, arguments.identity, arguments.noise, arguments.speed, arguments.memory
    every = not any(asked)
    if every or arguments.detection or arguments.identity or arguments.noise:
        truth = read_truth(arguments.data / "boxes" / "mot15-PETS09-S2L1" / "gt" / "gt.txt")
        video = arguments.data / "video" / "vtest.avi"
        found = detect(video, arguments.side)
        if every or arguments.detection:
            print_detection(found, truth)
        if every or arguments.identity:
            print_identity(found, truth)
            jittered = []
            for seed in range(arguments.jitter):
                print(f"jittered, seed {seed}:")
                jittered.append(print_identity(detect(video, arguments.side, seed), truth))
            if jittered:
                success, wrong = np.mean(jittered, axis=0)
                print(f"mean of {len(jittered)} seeds{success:17.3f}{wrong:9.3f}")
        if every or arguments.noise:
            print_noise(found, truth)
    if every or arguments.speed:
        print_speed(arguments.data / "video")
    if arguments.memory:
        print_memory(arguments.data / "video", arguments.memory)


def read_truth(path: Path) -> list[dict[int, np.ndarray]]:
    """For each frame: the corners of each person's box by number."""
    rows = np.loadtxt(path, delimiter=",")
    frames: list[dict[int, np.ndarray]] = [{} for _ in range(int(rows[:, 0].max()))]
    for frame, person, left, top, width, height in rows[:, :6]:
        frames[int(frame) - 1][int(person)] = np.array([left, top, left + width, top + height])
    return frames


def detect(
    video: Path, side: int = SIDE, seed: int | None = None
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """For each frame: boxes, scores, looks and the camera's motion; with a seed, jittered."""
    detector, motion = NanoDet(shipped("nanodet_g_int8.onnx"), ("person",), side=side), CameraMotion()
    rng = None if seed is None else np.random.default_rng(seed)
    frames = []
    for picture in pictures(video):
        people = detector(picture)
        boxes, scores = people.boxes, people.scores
        moved = motion(picture, boxes)
        if rng is not None:
            kept = rng.random(len(boxes)) >= DROPPED
            boxes, scores = boxes[kept], scores[kept]
            sizes = np.tile(boxes[:, 2:] - boxes[:, :2], 2)
            boxes = (boxes + rng.normal(0.0, OFF, boxes.shape) * sizes).astype(np.float32)
        frames.append((boxes, scores, appearances(picture, boxes), moved))
    return frames


def pictures(video: Path, size: tuple[int, int] | None = None):
    capture = Capture(str(video))
    while capture.grab():
        picture = capture.rgb()
        yield picture if size is None else cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    capture.close()


def print_detection(found, truth) -> None:
    print("people found, NanoDet-g in 8 bits at 416: score   recall  precision")
    for threshold in THRESHOLDS:
        right = people = detections = 0
        for (boxes, scores, _, _), there in zip(found, truth, strict=True):
            kept = boxes[scores >= threshold]
            people += len(there)
            detections += len(kept)
            if len(kept) and there:
                right += matches(overlap(kept, np.array(list(there.values()))))
        print(f"{threshold:46.2f}{right / people:9.3f}{right / detections:11.3f}")


def matches(shared: np.ndarray) -> int:
    shared, count = shared.copy(), 0
    while shared.max() > MATCH:
        row, column = np.unravel_index(int(shared.argmax()), shared.shape)
        shared[row, :] = shared[:, column] = 0
        count += 1
    return count


def print_identity(found, truth) -> tuple[float, float]:
    """Print what became of each person, and return the means over people of success and wrong person."""
    print("one person kept           success    wrong       EL   frames")
    rows = []
    for person in sorted({person for frame in truth for person in frame}):
        rows.append(follow(person, found, truth))
        success, wrong, length, frames = rows[-1]
        print(f"person {person:2d}{success:24.2f}{wrong:9.2f}{length:9.2f}{frames:9d}")
    success, wrong, length, frames = np.array(rows).T
    means = f"{success.mean():15.3f}{wrong.mean():9.3f}{length.mean():9.3f}{frames.sum():9.0f}"
    print(f"mean of {len(rows)} people{means}")
    share = frames / frames.sum()
    print(f"mean of all frames{success @ share:15.3f}{wrong @ share:9.3f}")
    return success.mean(), wrong.mean()


def follow(person: int, found, truth) -> tuple[float, float, float, int]:
    right = wrong = frames = misses = 0
    length = None
    for number, box in kept(person, found, truth):
        there = truth[number]
        mine = box is not None and overlap(box, there[person][None])[0, 0] > MATCH
        others = [theirs for other, theirs in there.items() if other != person]
        theirs = box is not None and others and overlap(box, np.array(others)).max() > MATCH
        frames += 1
        right += mine
        wrong += theirs and not mine
        misses = 0 if mine else misses + 1
        if misses == LOST_FRAMES and length is None:
            length = frames - LOST_FRAMES
    return right / frames, wrong / frames, (frames if length is None else length) / frames, frames


def kept(person: int, found, truth):
    """Each of the person's frames, by number, and the box (1, 4) that the lock says is theirs, or None."""
    lock = None
    numbers = [number for number, there in enumerate(truth) if person in there]
    for number in range(numbers[0], numbers[-1] + 1):
        boxes, scores, looks, motion = found[number]
        there = truth[number]
        t_ns = round(number / RATE_HZ * 1e9)
        place = expected = None
        if lock is None:
            if person in there and len(boxes):
                shared = overlap(boxes, there[person][None])[:, 0]
                place = int(shared.argmax()) if shared.max() > MATCH else None
            if place is not None:
                lock = TargetLock()
                lock.choose(place, boxes, looks, t_ns)
        else:
            locked = lock.update(boxes, scores, looks, motion, t_ns)
            place, expected = locked.place, locked.expected
        if person in there:
            box = expected if place is None else boxes[place]
            yield number, None if box is None else np.array(box, np.float32)[None]


def print_noise(found, truth) -> None:
    runs: list[int] = []
    frames = 0
    for person in sorted({person for frame in truth for person in frame}):
        missing = 0
        for _, box in kept(person, found, truth):
            frames += 1
            if box is None:
                missing += 1
            elif missing:
                runs.append(missing)
                missing = 0
        runs += [missing] if missing else []
    short = [run for run in runs if run <= RATE_HZ]
    long_s = sorted(run / RATE_HZ for run in runs if run > RATE_HZ)
    false = sum(
        int(not len(there) or overlap(box[None], np.array(list(there.values()))).max() < FALSE)
        for (boxes, scores, _, _), there in zip(found, truth, strict=True)
        for box in boxes[scores >= SURE_SCORE]
    )
    print(f"{frames} frames of {frames / RATE_HZ:.0f} s; false people a frame: {false / len(found):.2f}")
    mean_s = np.mean(short) / RATE_HZ
    print(f"without a box in runs of up to 1 s: {sum(short) / frames:.1%}, {mean_s:.2f} s a run")
    print(f"longer runs, s: {' '.join(f'{run:.1f}' for run in long_s)}")


def print_speed(videos: Path) -> None:
    cv2.setNumThreads(1)
    print("frame of 640x480 to observation, two cores    p50 ms   p95 ms   CPU ms     Hz   target seen")
    for video in sorted(videos.iterdir()):
        detector = NanoDet(shipped("nanodet_g_int8.onnx"), ("person", "obstacles"))
        selfie = SelfieMasks(shipped("selfie_segmentation.onnx"))
        heads = PoseMasks(shipped("pose_landmark_lite.onnx"), selfie)
        segmenter = TargetSegmenter(detector, heads, Choice())
        times_ms, cpu_ms, seen = [], [], 0
        for number, picture in enumerate(pictures(video, (640, 480))):
            began, cpu = time.perf_counter(), time.process_time()
            observation = segmenter(Frame(picture, number * 40_000_000, number))
            times_ms.append((time.perf_counter() - began) * 1e3)
            cpu_ms.append((time.process_time() - cpu) * 1e3)
            seen += observation.box is not None
        p50, p95 = np.percentile(times_ms, (50, 95))
        print(
            f"{video.name:46}{p50:6.1f}{p95:9.1f}{np.median(cpu_ms):9.1f}{1e3 / np.mean(times_ms):7.1f}"
            f"{seen / len(times_ms):13.0%}"
        )
    print("model alone, one thread                       p50 ms   p95 ms")
    picture = next(pictures(sorted(videos.iterdir())[0], (640, 480)))
    box = np.array([[200, 100, 320, 440]], np.float32)
    selfie = SelfieMasks(shipped("selfie_segmentation.onnx"))
    heads = {
        "pose landmarks, the target": PoseMasks(shipped("pose_landmark_lite.onnx"), selfie),
        "selfie segmentation, a person": selfie,
    }
    alone = {
        f"NanoDet-g {kind} at {side}": NanoDet(shipped(f"nanodet_g_{kind}.onnx"), ("person",), side=side)
        for kind in ("int8", "fp32")
        for side in (416, 320)
    }
    cut_out = {name: partial(head, boxes=box, size=160) for name, head in heads.items()}
    for name, run in {**alone, **cut_out}.items():
        times_ms = []
        for _ in range(60):
            began = time.perf_counter()
            run(picture)
            times_ms.append((time.perf_counter() - began) * 1e3)
        print(f"{name:46}{np.median(times_ms):6.1f}{np.percentile(times_ms, 95):9.1f}")


def print_memory(videos: Path, frames: int) -> None:
    cv2.setNumThreads(1)
    segmenter, _ = open_segmenter(EMBEDDED, "person, obstacles", Choice())
    clock = MonotonicClock()
    print("  frames  clips opened  resident MiB  threads  files        s")
    seen, began_s = 0, time.monotonic()
    for opened, video in enumerate(itertools.cycle(sorted(videos.iterdir())), start=1):
        camera = FileCamera(video, every_frame=True)
        camera.open()
        segmenter.reset()
        last = None
        with Perception(camera, segmenter, clock, LOOK_HZ) as perception:
            while seen < frames:
                try:
                    newest = perception.newest()
                except FilmOverError:
                    break
                if newest is None or newest is last:
                    time.sleep(0.002)
                    continue
                last = newest
                seen += 1
                if seen % max(1, frames // TOLD) == 0:
                    files = sum(1 for _ in Path("/proc/self/fd").iterdir())
                    print(
                        f"{seen:8d}{opened:14d}{resident_mib():14.1f}{threading.active_count():9d}{files:7d}"
                        f"{time.monotonic() - began_s:9.0f}",
                        flush=True,
                    )
        camera.close()
        if seen >= frames:
            return


def resident_mib() -> float:
    """Resident memory of this process, as Linux counts it."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


if __name__ == "__main__":
    main()
