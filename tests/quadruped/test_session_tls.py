"""A session with certificates on both sides: who gets through, and who does not."""

from dataclasses import replace
from pathlib import Path

import pytest

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_quadruped.protocol.connection import Connection, Tls
from adatracker_quadruped.protocol.session import open_session
from tests.quadruped.certificates import issue
from tests.quadruped.routers import arrives, free_port, latest, publisher_of, robot

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tls")
    issue("authority", folder)
    issue("stranger", folder)
    issue("robot", folder, "authority")
    issue("host", folder, "authority")
    issue("elsewhere", folder, "authority", place="DNS:elsewhere.local")
    issue("intruder", folder, "stranger")

    def tls(name="", authority="authority"):
        pair = (f"{folder}/{name}.pem", f"{folder}/{name}.key") if name else ("", "")
        return Tls(root_ca=f"{folder}/{authority}.pem", certificate=pair[0], private_key=pair[1])

    return tls


@pytest.fixture
def guarded(certificates):
    """Return the connection of a robot that asks for a certificate."""
    return Connection(
        endpoint=f"tls/127.0.0.1:{free_port()}", tls=certificates("robot"), connect_timeout_s=0.5
    )


def test_a_host_with_a_certificate_gets_through_to_a_robot_that_asks_for_one(guarded, certificates):
    with robot(guarded) as far, open_session(replace(guarded, tls=certificates("host"))) as host:
        assert arrives(publisher_of(host, "cmd_vel"), latest(far, "cmd_vel"), b"walk") == b"walk"


@pytest.mark.parametrize(
    ("name", "authority"),
    [("", "authority"), ("intruder", "authority"), ("host", "stranger")],
    ids=["no certificate", "a stranger's certificate", "a robot nobody vouches for"],
)
def test_without_trust_on_both_sides_there_is_no_session(guarded, certificates, name, authority):
    with robot(guarded), pytest.raises(PlatformError, match=r"connection\.tls fits its certificate"):
        open_session(replace(guarded, tls=certificates(name, authority)))


def test_a_host_in_the_clear_reaches_no_encrypted_robot(guarded):
    plain = replace(guarded, endpoint=guarded.endpoint.replace("tls/", "tcp/"), tls=None)
    with robot(guarded), pytest.raises(PlatformError, match="no Zenoh router"):
        open_session(plain)


def test_a_robot_with_another_robots_certificate_is_refused_unless_names_do_not_count(guarded, certificates):
    posing, host = replace(guarded, tls=certificates("elsewhere")), certificates("host")
    with robot(posing):
        with pytest.raises(PlatformError, match=r"connection\.tls fits its certificate") as refusal:
            open_session(replace(posing, tls=host))
        assert "\n" not in str(refusal.value)
        open_session(replace(posing, tls=replace(host, verify_name=False))).close()


def test_a_private_key_that_others_may_read_is_refused(guarded, certificates, tmp_path):
    key = tmp_path / "host.key"
    key.write_bytes(Path(certificates("host").private_key).read_bytes())
    key.chmod(0o640)
    with pytest.raises(UsageError, match="chmod 600"):
        open_session(replace(guarded, tls=replace(certificates("host"), private_key=str(key))))


def test_a_missing_certificate_file_is_named():
    lost = Connection(endpoint="tls/127.0.0.1:7447", tls=Tls(root_ca="nowhere/ca.pem"))
    with pytest.raises(UsageError, match=r"no such file: nowhere/ca\.pem"):
        open_session(lost)
