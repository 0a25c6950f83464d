"""A session with certificates on both sides: who gets through, and who does not."""

import subprocess
from dataclasses import replace

import pytest

from adatracker_deploy.errors import PlatformError, UsageError
from adatracker_quadruped.connection import Connection, Tls
from adatracker_quadruped.session import open_session
from tests.quadruped.routers import arrives, free_port, latest, publisher_of, robot


def openssl(*arguments, cwd):
    subprocess.run(["openssl", *arguments], cwd=cwd, check=True, capture_output=True)


def issue(name, folder, authority=None):
    """Make a key and a certificate for 127.0.0.1, signed by an authority or by itself."""
    key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2"]
    signed = ["-CA", f"{authority}.pem", "-CAkey", f"{authority}.key"] if authority else []
    kind = "basicConstraints=critical,CA:FALSE" if authority else "basicConstraints=critical,CA:TRUE"
    openssl(
        *(
            "req",
            "-x509",
            *key,
            *signed,
            "-subj",
            f"/CN={name}",
            "-keyout",
            f"{name}.key",
            "-out",
            f"{name}.pem",
        ),
        *("-addext", "subjectAltName=IP:127.0.0.1", "-addext", kind),
        cwd=folder,
    )


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tls")
    issue("authority", folder)
    issue("stranger", folder)
    issue("robot", folder, "authority")
    issue("host", folder, "authority")
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


def test_a_missing_certificate_file_is_named():
    lost = Connection(endpoint="tls/127.0.0.1:7447", tls=Tls(root_ca="nowhere/ca.pem"))
    with pytest.raises(UsageError, match=r"no such file: nowhere/ca\.pem"):
        open_session(lost)
