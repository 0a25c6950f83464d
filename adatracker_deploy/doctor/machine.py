"""Checks the machine: `machine_checks` reads its state from Linux, pure functions judge it."""

from __future__ import annotations

import os
import shutil
import time
from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.onnx_session import available_providers, runtime_distributions
from adatracker_deploy.platform import Check
from adatracker_deploy.runtime.scheduling import MEND, MEND_AWAKE, MEND_AWAKE_RULE, Scheduling

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

FEWEST_CORES = 2
"""One for the tracker, one for its perception."""
LOG_BYTES_PER_S = 1_000_000
"""Approximate log rate of a trial with 640x480 images at 20 Hz, bytes/s."""
LEAST_LOG_S, FEW_LOG_S = 300, 3600
"""Seconds of trials that must fit on the disk; and the level below which to warn."""
STEADY_CLOCKS = ("tsc", "arch_sys_counter", "kvm-clock", "hyperv_clocksource_tsc_page")
"""Linux clock sources that are read in nanoseconds, without a system call to a slow device."""
COARSEST_CLOCK_S = 1e-6

_FIX_PRIORITY = """sudo groupadd --force realtime
sudo usermod --append --groups realtime "$USER"  # then log in again
echo '@realtime - rtprio 50' | sudo tee /etc/security/limits.d/adatracker.conf"""
_FIX_AWAKE = f"""echo '{MEND_AWAKE_RULE}' | sudo tee /etc/udev/rules.d/60-cpu-dma-latency.rules
sudo udevadm control --reload
sudo udevadm trigger --name-match=cpu_dma_latency"""

_GOVERNORS = Path("/sys/devices/system/cpu")
_STAT = Path("/proc/stat")
_STEAL = 8
"""Column of steal time in /proc/stat: a core was ready to run, but the host ran others (proc_stat(5))."""
_CLOCK = Path("/sys/devices/system/clocksource/clocksource0/current_clocksource")


def machine_checks(place: Path) -> tuple[Check, ...]:
    """Run all quick checks of this machine; `place` is the folder for logs."""
    governors = {path.read_text().strip() for path in _GOVERNORS.glob("cpu[0-9]*/cpufreq/scaling_governor")}
    return (
        cores_check(len(os.sched_getaffinity(0)), os.getloadavg()[0]),
        governor_check(governors),
        realtime_check(_may_have_priority(), _may_keep_awake()),
        clock_check(
            _CLOCK.read_text().strip() if _CLOCK.exists() else None,
            time.get_clock_info("monotonic").resolution,
        ),
        space_check(shutil.disk_usage(place).free, place),
        onnxruntime_check(runtime_distributions(), available_providers()),
    )


def onnxruntime_check(distributions: Mapping[str, str], providers: Sequence[str]) -> Check:
    """Check that one package brings onnxruntime, and tell the execution providers that it has.

    Args:
        distributions: versions of the installed packages that bring it, by name.
        providers: as users write them.
    """
    told = ", ".join(f"{name} {version}" for name, version in distributions.items()) or "of no known package"
    told += f", has {', '.join(providers)}"
    if len(distributions) < 2:
        return Check("onnxruntime", True, told)
    keep = [name for name in distributions if name != "onnxruntime"][-1]
    fix = f"pip uninstall --yes {' '.join(distributions)}\npip install {keep}"
    mend = f"they overwrite each other's files: {fix.replace(chr(10), ' && ')}"
    return Check("onnxruntime", False, f"{told}: {mend}", fix=fix)


def stolen_s() -> float:
    """Return the time stolen by the host since this machine started, s, summed over cores.

    0 on bare metal, and where the system does not report it.
    """
    if not _STAT.exists():
        return 0.0
    return int(_STAT.read_text().split(maxsplit=_STEAL + 1)[_STEAL]) / os.sysconf("SC_CLK_TCK")


def cores_check(count: int, load: float) -> Check:
    """Check the number of usable cores and their load in the last minute."""
    if count < FEWEST_CORES:
        return Check("cores", False, f"{count}: perception and the loop want {FEWEST_CORES}", blocking=False)
    if load > count / 2:
        return Check("cores", False, f"{count}, load {load:.1f}: stop what else runs here", blocking=False)
    return Check("cores", True, f"{count}, load {load:.1f}")


def governor_check(governors: set[str]) -> Check:
    """Check the cores' frequency governors; none where the machine does not report them."""
    if not governors:
        return Check("frequency", True, "not adjustable on this machine")
    ok = governors == {"performance"}
    fix = "" if ok else "sudo cpupower frequency-set -g performance"
    mend = f": {fix}" if fix else ""
    return Check("frequency", ok, f"governor {', '.join(sorted(governors))}{mend}", blocking=False, fix=fix)


def realtime_check(allowed: bool, awake: bool) -> Check:
    """Check whether this process may have what ``--realtime`` needs: priority, and cores kept awake."""
    if allowed:
        sleep = "keeps cores awake" if awake else f"cores may sleep; to keep them awake: {MEND_AWAKE}"
        fix = "" if awake else _FIX_AWAKE
        return Check("real-time priority", True, f"allowed: --realtime, {sleep}", fix=fix)
    fix = f"{_FIX_PRIORITY}\n{_FIX_AWAKE}"
    return Check("real-time priority", False, f"not allowed: {MEND}", blocking=False, fix=fix)


def _may_have_priority() -> bool:
    try:
        Scheduling(realtime=True).check()
    except UsageError:
        return False
    return True


def _may_keep_awake() -> bool:
    with Scheduling(realtime=True).awake() as awake:
        return awake


def clock_check(source: str | None, resolution_s: float) -> Check:
    """Check the monotonic clock."""
    told = f"{source or 'unknown source'}, resolution {resolution_s * 1e9:.0f} ns"
    steady = source is None or source in STEADY_CLOCKS
    if steady and resolution_s <= COARSEST_CLOCK_S:
        return Check("clock", True, told)
    return Check("clock", False, f"{told}: boot with clocksource=tsc if the processor has it", blocking=False)


def space_check(free_bytes: int, folder: Path) -> Check:
    """Check the disk space for logs; too little blocks."""
    left_s = free_bytes / LOG_BYTES_PER_S
    told = f"{free_bytes / 1e9:.1f} GB free at {folder}, {left_s / 3600:.1f} h of trials"
    if left_s >= FEW_LOG_S:
        return Check("disk space", True, told)
    return Check(
        "disk space",
        False,
        f"{told}: remove old trials, or choose another --log-dir",
        blocking=left_s < LEAST_LOG_S,
    )
