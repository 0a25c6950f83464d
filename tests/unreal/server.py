"""An UnrealCV server whose game is the toolkit's own world.

It answers over a real socket as UnrealCV's plugin does (`Source/UnrealCV/Private`, ec12043): message frames,
patterns of commands, `%.3f`, error texts, one client at a time. It changes frames by the engine's own formula
of a rotation matrix, not by the code under test.
"""

from __future__ import annotations

import contextlib
import math
import re
import socket
import struct
import threading
from pathlib import Path

import cv2
import numpy as np

from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.sim.world import World

LIFT_CM = 87.5
"""Height of a character's origin, the middle of its capsule, above its feet."""
TARGET, CRATE, FLOOR = "BP_Character_2", "SM_Crate_7", "SM_Floor_01"
RADIUS_M = 0.3
NUMBER = r"([-+]?\d*[.]?\d+)"
"""The dispatcher's own pattern: no exponent."""
THREE = " ".join([NUMBER] * 3)


def pose_of(location, rotation):
    """Return the pose of a place and a rotation of the engine, by its rotation matrix.

    The rows are FRotationMatrix's axes (Engine/Source/Runtime/Core/Public/Math/RotationTranslationMatrix.h).
    """
    pitch, yaw, roll = map(math.radians, rotation)
    sp, cp, sy, cy = math.sin(pitch), math.cos(pitch), math.sin(yaw), math.cos(yaw)
    sr, cr = math.sin(roll), math.cos(roll)
    forward = np.array([cp * cy, cp * sy, sp])
    right = np.array([sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, -sr * cp])
    mirror = np.array([1.0, -1.0, 1.0])
    ahead, left = forward * mirror, -right * mirror
    above = np.cross(ahead, left)
    x, y, z = (value / 100 for value in location)
    return Pose(
        x,
        -y,
        z,
        math.atan2(left[2], above[2]),
        -math.asin(max(-1.0, min(1.0, ahead[2]))),
        math.atan2(ahead[1], ahead[0]),
    )


class Game:
    """The game: a world a reset, and what the commands say of it."""

    def __init__(self, worlds, clock=None, level="simple_room"):
        self._worlds, self.clock = iter(worlds), clock or FakeClock()
        self.world = World("simple_room", seed=0)
        self.level, self._opening = level, ""
        self.paused, self._since_ns = False, self.clock.now_ns()
        self.colours = {TARGET: (9, 9, 9), CRATE: (8, 8, 8), FLOOR: (7, 7, 7)}
        self.hidden, self.walking, self.speeds = set(), set(), {}
        self.places = {}
        """Location and rotation of what the client places: the robot's body."""
        self.lens = {"size": (640, 480), "fov": (90.0,), "location": (0, 0, 0), "rotation": (0, 0, 0)}
        self.cameras = 1
        self.heard = []

    @property
    def robot(self):
        """The robot's body, where the world has it; None before it is placed."""
        if "adatracker_robot" not in self.places:
            return None
        (x, y, z), rotation = self.places["adatracker_robot"]
        pose = pose_of((x, y, z - LIFT_CM), rotation)
        above = pose.z - self.world.ground_z(pose.x, pose.y)
        return self.world.grounded(pose, RADIUS_M) if above < 0.5 else pose

    def answer(self, command):
        self.heard.append(command)
        if not self.paused:
            self._pass_time()
        for pattern, answer in ANSWERS:
            if found := re.fullmatch(pattern, command):
                return answer(self, *found.groups())
        return f"error Can not find a handler for URI {command}"

    def _pass_time(self):
        since_ns, self._since_ns = self._since_ns, self.clock.now_ns()
        if TARGET in self.walking and self._since_ns > since_ns:
            self.world.step((self._since_ns - since_ns) / 1e9, self.robot)

    def pause(self):
        self.paused = True
        return "ok"

    def resume(self):
        self.paused, self._since_ns = False, self.clock.now_ns()
        return "ok"

    def open_level(self, name):
        self._opening = name
        return "ok"

    def level_name(self):
        self.level, self._opening, name = self._opening or self.level, "", self.level
        return name

    def spawn(self, kind, name):
        if kind != "bp_character_C":
            return f"error Can not find a class with name '{kind}'"
        if name in self.colours:
            return f"error Failed to spawn {name}, object exists."
        self.colours[name] = (5, 5, 5)
        if name == "adatracker_robot":
            self.places[name] = (0.0, 0.0, LIFT_CM), (0.0, 0.0, 0.0)
        return name

    def spawn_camera(self):
        self.cameras += 1
        return f"FusionCameraActor_{self.cameras}"

    def person(self, name):
        """Return somebody's place in the list of people."""
        others = [one for one in self.colours if one not in {TARGET, CRATE, FLOOR, "adatracker_robot"}]
        return [TARGET, *others].index(name)

    def get(self, name, what):
        if name not in self.colours:
            return "error Cannot find object"
        if name in self.places:
            pose = self.robot
            heading, (x, y, z) = math.degrees(pose.yaw), (pose.x, pose.y, pose.z)
            tilt = -math.degrees(pose.pitch), math.degrees(pose.roll)
        else:
            walker = self.world._walkers[self.person(name)]
            x, y = walker.x, walker.y
            z, heading, tilt = self.world.ground_z(x, y), math.degrees(walker.heading), (0.0, 0.0)
        if what == "location":
            return f"{x * 100:.3f} {-y * 100:.3f} {z * 100 + LIFT_CM:.3f}"
        if what == "rotation":
            return f"{tilt[0]:.3f} {math.remainder(-heading, 360):.3f} {tilt[1]:.3f}"
        corners = (x - 0.3, -y - 0.3, z, x + 0.3, -y + 0.3, z + 1.75)
        return " ".join(f"{100 * value:.2f}" for value in corners)

    def put(self, name, what, *numbers):
        if name not in self.colours:
            return "error Cannot find object"
        values = tuple(map(float, numbers))
        if name in self.places:
            location, rotation = self.places[name]
            self.places[name] = (values, rotation) if what == "location" else (location, values)
        elif self.person(name) < len(self.world._walkers):
            walker = self.world._walkers[self.person(name)]
            pose = pose_of(values, (0, 0, 0)) if what == "location" else pose_of((0, 0, 0), values)
            if what == "location":
                walker.x, walker.y = pose.x, pose.y
            else:
                walker.heading = pose.yaw
        return "ok"

    def colour(self, name, *rgb):
        if name not in self.colours:
            return "error Cannot find object"
        self.colours[name] = tuple(map(int, rgb))
        return "ok"

    def blueprint(self, name, function, words):
        if name not in self.colours:
            return f"error Can not find actor with id '{name}'"
        if function == "reset" and name == TARGET:
            self.world = next(self._worlds, self.world)
            self.walking.clear()
        elif function == "set_speed":
            self.speeds[name] = float(words)
        elif function == "nav_random":
            self.walking.add(name)
            return '{"nav_goal":"X=1.000 Y=2.000 Z=3.000"}'
        elif function == "nav_to_goal":
            self.walking.discard(name)
        elif function == "get_hit":
            robot = self.robot
            return f'{{"hit":"{int(self.world.contact(robot.x, robot.y, robot.z, RADIUS_M) is not None)}"}}'
        elif function not in {"reset", "set_phy"}:
            return f"error {function}"
        return "{}"

    def show(self, name, how):
        (self.hidden.discard if how == "show" else self.hidden.add)(name)
        return "ok"

    def aim(self, camera, what, numbers):
        if int(camera) >= self.cameras:
            return "error Invalid sensor id"
        self.lens[what] = tuple(map(float, numbers.split()))
        return "ok"

    def look(self, camera, mode):
        if int(camera) >= self.cameras:
            return "error Invalid sensor id"
        width, height = map(int, self.lens["size"])
        eye = pose_of(self.lens["location"], self.lens["rotation"])
        seen_from = eye, math.radians(self.lens["fov"][0]), height, width
        if mode == "lit":
            image = self.world.render(*seen_from)[1]
        else:
            other = next((c for n, c in self.colours.items() if n.startswith("adatracker_person")), (6, 6, 6))
            palette = {
                MaskClass.BACKGROUND: self.colours[FLOOR],
                MaskClass.TARGET: self.colours[TARGET],
                MaskClass.PERSON: other,
                MaskClass.OBSTACLE: self.colours[CRATE],
            }
            colours = np.array([palette[kind] for kind in MaskClass], np.uint8)
            image = colours[self.world.render_mask(*seen_from)]
        if "adatracker_robot" not in self.hidden:
            image = np.full_like(image, 4)  # the camera is inside its own body
        alpha = np.full((height, width, 1), 255, np.uint8)
        return cv2.imencode(".png", np.concatenate((image[:, :, ::-1], alpha), axis=2))[1].tobytes()


ANSWERS = (
    (r"vget /unrealcv/status", lambda game: "Is Listening\nClient Connected\n"),
    (r"vget /level/name", Game.level_name),
    (r"vset /action/game/level ([^ ]*)", Game.open_level),
    (r"vset /action/game/pause", Game.pause),
    (r"vset /action/game/resume", Game.resume),
    (r"vget /objects", lambda game: "".join(f"{name} " for name in game.colours)),
    (r"vset /objects/spawn ([^ ]*) ([^ ]*)", Game.spawn),
    (r"vget /object/([^ /]*)/(location|rotation|bounds)", Game.get),
    (rf"vset /object/([^ /]*)/(location|rotation) {THREE}", Game.put),
    (r"vset /object/([^ /]*)/color (\d*) (\d*) (\d*)", Game.colour),
    (r"vset /object/([^ /]*)/(show|hide)", Game.show),
    (r"vset /cameras/spawn", Game.spawn_camera),
    (r"vget /cameras", lambda game: "FusionCamSensor " * game.cameras),
    (rf"vset /camera/(\d+)/(location|rotation) ({NUMBER} {NUMBER} {NUMBER})", lambda g, *a: g.aim(*a[:3])),
    (rf"vset /camera/(\d+)/(fov) ({NUMBER})", lambda g, *a: g.aim(*a[:3])),
    (r"vset /camera/(\d+)/(size) (\d+ \d+)", Game.aim),
    (r"vget /camera/(\d+)/(lit|object_mask) png", Game.look),
    (r"vbp ([^ ]*) ([^ ]*) ?(.*)", Game.blueprint),
)


class Server:
    """Serves a game on 127.0.0.1; a context manager."""

    def __init__(self, game, *, unix=False):
        self.game, self._unix = game, unix
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.path = Path(f"/tmp/unrealcv_{self.port}.socket")
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._wire = None

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self.cut()
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join(10)
        self.path.unlink(missing_ok=True)

    def scene(self, query=""):
        return f"unrealcv/127.0.0.1:{self.port}/simple_room{query}"

    def cut(self):
        """End the connection."""
        if self._wire is not None:
            with contextlib.suppress(OSError):
                self._wire.shutdown(socket.SHUT_RDWR)

    def _serve(self):
        with contextlib.suppress(OSError):
            while True:
                with self._listener.accept()[0] as self._wire, contextlib.suppress(OSError, EOFError):
                    self._converse(self._wire)
                if self._unix:  # as the plugin does on Linux: one client over TCP, the next ones here
                    self._listener.close()
                    self._listener = socket.socket(socket.AF_UNIX)
                    self._listener.bind(str(self.path))
                    self._listener.listen(1)
                    self._unix = False

    def _converse(self, wire):
        send(wire, b"connected to ExampleScene")
        while True:
            number, command = re.fullmatch(r"(\d+):(.*)", receive(wire).decode()).groups()
            reply = self.game.answer(command)
            send(wire, f"{number}:".encode() + (reply if isinstance(reply, bytes) else reply.encode()))


def send(wire, payload):
    wire.sendall(struct.pack("<II", 0x9E2B83C1, len(payload)) + payload)


def receive(wire):
    magic, size = struct.unpack("<II", exactly(wire, 8))
    assert magic == 0x9E2B83C1
    return exactly(wire, size)


def exactly(wire, size):
    data = b""
    while len(data) < size:
        part = wire.recv(size - len(data))
        if not part:
            raise EOFError
        data += part
    return data
