"""A bare Go2 on this machine: its sport service over real DDS, on loopback and without multicast."""

import contextlib
import os
import random
import signal
import subprocess
import sys
import threading
import time

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Twist
from adatracker_quadruped.protocol import sport, unitree
from adatracker_quadruped.protocol.messages import Odometry

LOOPBACK = (
    '<CycloneDDS><Domain Id="any"><General><AllowMulticast>false</AllowMulticast>'
    '<Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces></General>'
    "<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>9</MaxAutoParticipantIndex>"
    '<Peers><Peer Address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>'
)
PLACE, WALK = Pose(x=1.5, y=-0.5, z=0.3, yaw=0.4), Twist(vx=0.25, yaw_rate=-0.125)
CHARGE = 0.87


class BareGo2:
    """Tells where it is, and remembers what it was asked for as (seconds, `SportRequest`)."""

    def __init__(self):
        from cyclonedds.core import Policy, Qos
        from cyclonedds.domain import Domain, DomainParticipant
        from cyclonedds.pub import DataWriter
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        from adatracker_quadruped.robot import dds

        self.domain = random.SystemRandom().randrange(100, 200)
        self._domain = Domain(self.domain, LOOPBACK)
        participant = DomainParticipant(self.domain)

        def topic(name, kind):
            return Topic(participant, name, dds.dds_type(kind))

        every = Qos(Policy.Reliability.Reliable(0), Policy.History.KeepAll)
        self._requests = DataReader(participant, topic(dds.REQUESTS, sport.REQUEST), every)
        self._state = DataWriter(participant, topic(dds.SPORT_STATE, unitree.SPORT_MODE_STATE))
        self._low = DataWriter(participant, topic(dds.LOW_STATE, unitree.LOW_STATE))
        self._types = {kind: dds.dds_type(kind) for kind in (unitree.SPORT_MODE_STATE, unitree.LOW_STATE)}
        self.asked = []
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._live)
        self._thread.start()

    def _live(self):
        path = bytes(280)
        while not self._over.wait(0.01):
            state = unitree.encode_sport_mode_state(Odometry(PLACE, WALK, time.time_ns()))
            self._state.write(self._types[unitree.SPORT_MODE_STATE].deserialize(state + path))
            self._low.write(self._types[unitree.LOW_STATE].deserialize(unitree.encode_low_state(CHARGE)))
            for sample in self._requests.take(50):
                with contextlib.suppress(AttributeError):  # an invalid sample: the writer has gone
                    request = sport.decode_request(bytes(sample.serialize(use_version_2=False)))
                    self.asked.append((time.monotonic(), request))

    @property
    def moves(self):
        return [request.twist for _, request in self.asked if request.api_id == sport.MOVE]

    @property
    def stops(self):
        return [at_s for at_s, request in self.asked if request.api_id == sport.STOP_MOVE]

    def close(self):
        self._over.set()
        self._thread.join()


@contextlib.contextmanager
def node(go2, port, *more):
    """The node as systemd starts it; gives its process once hosts can dial."""
    listen = f"tcp/127.0.0.1:{port}"
    process = subprocess.Popen(
        (
            *(sys.executable, "-m", "adatracker_quadruped.robot"),
            *("--listen", listen, "--domain", str(go2.domain), *more),
        ),
        env={**os.environ, "CYCLONEDDS_URI": LOOPBACK},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert "hosts dial" in process.stdout.readline()
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(10)
        process.stdout.close()
