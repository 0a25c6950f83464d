"""Certificates of an authority of our own, made by openssl."""

import subprocess


def openssl(*arguments, cwd):
    subprocess.run(["openssl", *arguments], cwd=cwd, check=True, capture_output=True)


def issue(name, folder, authority=None, place="IP:127.0.0.1"):
    """Make a key and a certificate for 127.0.0.1 or another place, signed by an authority or by itself."""
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
        *("-addext", f"subjectAltName={place}", "-addext", kind),
        cwd=folder,
    )
