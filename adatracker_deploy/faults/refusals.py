"""Negative tests: makes each invalid request for real and checks that it is refused before anything moves."""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from adatracker_deploy.faults.judge import Result
from adatracker_deploy.faults.rehearse import run_command
from adatracker_deploy.policy import bundles
from adatracker_deploy.policy.catalogue import DEFAULT
from adatracker_deploy.registry import load_platform, profile_dir

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from adatracker_deploy.faults.matrix import Refusal
    from adatracker_deploy.platform import Platform


def refuse(refusal: Refusal, platform_name: str, _: object, folder: Path) -> Result:
    """Make an invalid request, in `folder`, and check that nothing moves.

    A stall of the machine does not excuse a row here.
    """
    arguments = _WRONG[refusal.name](load_platform(platform_name), folder)
    done = run_command("--platform", platform_name, "--sitl", "--steps", "20", *arguments)
    said = " ".join(done.stderr.split())
    right = done.returncode == refusal.status and refusal.words in said and "Traceback" not in done.stderr
    moved = any(folder.rglob("trial.mcap*"))
    return Result(
        platform=platform_name,
        fault=refusal.name,
        says=refusal.says,
        limit=f"exit {refusal.status}",
        outcome=f"exit {done.returncode}",
        verdict="ok" if right and not moved else "WRONG",
        note="" if right and not moved else said[-200:],
    )


def _readonly(_: type[Platform], folder: Path) -> Sequence[str]:
    """Use a log folder below a regular file: not even root can write there."""
    (folder / "file").write_text("")
    return ("--log-dir", str(folder / "file" / "trials"))


def _corrupt(_: type[Platform], folder: Path) -> Sequence[str]:
    bundle = _copied_bundle(folder)
    model = bundle / "policy.onnx"
    data = bytearray(model.read_bytes())
    data[len(data) // 2] ^= 0xFF
    model.write_bytes(data)
    return _with_bundle(bundle, folder)


def _wrong_shape(_: type[Platform], folder: Path) -> Sequence[str]:
    """Put the encoder in the policy's place and fix hashes, sizes and seal, so that only its shapes are
    wrong."""
    bundle = _copied_bundle(folder)
    manifest, policy, encoder = (bundle / name for name in ("manifest.yaml", "policy.onnx", "encoder.onnx"))
    was, now = policy.read_bytes(), encoder.read_bytes()
    policy.write_bytes(now)
    body = manifest.read_text().partition("\n")[2]
    body = body.replace(hashlib.sha256(was).hexdigest(), hashlib.sha256(now).hexdigest())
    body = body.replace(f"bytes: {len(was)}", f"bytes: {len(now)}")
    seal = hashlib.sha256(body.encode()).hexdigest()
    manifest.write_text(f"# sha256 of all that follows: {seal}\n{body}")
    return _with_bundle(bundle, folder)


def _malformed(platform: type[Platform], folder: Path) -> Sequence[str]:
    return _with_profile(platform, folder, "limits", accel_m_s2="fast")


def _empty_battery(platform: type[Platform], folder: Path) -> Sequence[str]:
    return _with_profile(platform, folder, "sitl", battery=0.05)


def _copied_bundle(folder: Path) -> Path:
    return Path(shutil.copytree(Path(bundles.__file__).parent / DEFAULT, folder / "bundle"))


def _with_bundle(bundle: Path, folder: Path) -> Sequence[str]:
    return ("--policy", str(bundle), "--log-dir", str(folder / "trials"))


def _with_profile(platform: type[Platform], folder: Path, section: str, **changes: Any) -> Sequence[str]:
    """Return the arguments for the shipped profile with one section changed."""
    shipped = (platform.profile_dir or profile_dir()) / f"{platform.default_profile}.yaml"
    document = yaml.safe_load(shipped.read_text())
    document.setdefault(section, {}).update(changes)
    path = folder / "profile.yaml"
    path.write_text(yaml.safe_dump(document))
    return ("--profile", str(path), "--log-dir", str(folder / "trials"))


_WRONG: dict[str, Callable[[type[Platform], Path], Sequence[str]]] = {
    "log_readonly": _readonly,
    "model_corrupt": _corrupt,
    "model_wrong_shape": _wrong_shape,
    "profile_malformed": _malformed,
    "battery_at_start": _empty_battery,
}
