"""Decodes a base's condition from the signals of a state message, and encodes it for the simulator."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from adatracker_deploy.core.errors import UsageError
from adatracker_wheeled.protocol.dbc import Layout, Raw, Signal
from adatracker_wheeled.protocol.frames import BaseStatus, Mode
from adatracker_wheeled.protocol.roles import State, named_bits

_NAMES: dict[Mode, str] = {"ours": "commanded", "standby": "standby", "remote": "remote control"}
_WORST_FIRST: tuple[Mode, ...] = ("remote", "unknown", "standby", "ours")


class StatusCodec:
    """One state message, as `roles.State` describes it."""

    def __init__(self, state: State, layout: Layout) -> None:
        self.layout = layout
        self._state = state
        self._mode = layout.signal(state.mode)
        self._condition, self._errors, self._volts, self._count = (
            layout.signal(name) if name else None
            for name in (state.condition, state.errors, state.volts, state.count)
        )
        meanings: dict[Mode, tuple[int, ...]] = {
            "standby": state.standby,
            "ours": state.ours,
            "remote": state.remote,
        }
        self._modes: dict[Raw, Mode] = {raw: mode for mode, raws in meanings.items() for raw in raws}
        self._faults = dict(named_bits(state.faults))
        self._warnings = dict(state.warned)
        self._check_reach()

    def _check_reach(self) -> None:
        meant = (
            (self._mode, tuple(self._modes)),
            (self._condition, self._state.ok + self._state.emergency_stop),
            (self._errors, tuple(1 << bit for bit in (*self._faults, *self._warnings))),
        )
        if self._errors and (self._errors.low < 0 or self._errors.float_format):
            raise UsageError(
                f"{self.layout.dbc}: {self.layout.name}.{self._errors.name}: error bits must be unsigned"
            )
        for signal, raws in meant:
            for raw in raws:
                if signal is not None and not signal.low <= raw <= signal.high:
                    raise UsageError(f"{self.layout.dbc}: {self.layout.name}.{signal.name} is never {raw}")

    def read(self, raws: dict[str, Raw]) -> BaseStatus:
        """Tell what the signals of one message mean; a value that no list names is unknown, or a fault."""
        raw = raws[self._mode.name]
        mode = self._modes.get(raw, "unknown")
        condition = raws[self._condition.name] if self._condition else None
        stopped = condition in self._state.emergency_stop
        bits = int(raws[self._errors.name]) if self._errors else 0
        errors = [bit for bit in range(bits.bit_length()) if bits >> bit & 1]
        faults = _names(
            self._faults.get(bit, f"error bit {bit}") for bit in errors if bit not in self._warnings
        )
        if not faults and not stopped and condition is not None and condition not in self._state.ok:
            faults = f"condition {condition}"
        return BaseStatus(
            mode=mode,
            mode_name=_NAMES.get(mode, f"mode {raw}"[:23]),
            emergency_stop=stopped,
            fault=faults,
            warning=_names(self._warnings.get(bit, "") for bit in errors),
            volts=self._volts.to_value(raws[self._volts.name]) if self._volts else None,
            count=int(raws[self._count.name]) if self._count else None,
        )

    def write(self, status: BaseStatus, count: int) -> dict[str, Raw]:
        """Return the signals with which a base would say `status`.

        Raises:
            UsageError: the profile names no way to say it.
        """
        raws: dict[str, Raw] = {self._mode.name: self._raw_mode(status.mode)}
        bits = _bits(self._faults, status.fault)
        if self._errors:
            raws[self._errors.name] = sum(1 << bit for bit in bits | _bits(self._warnings, status.warning))
        if self._condition:
            raws[self._condition.name] = self._raw_condition(self._condition, status)
        elif status.emergency_stop or (status.fault and not bits):
            raise UsageError("names no signal that carries that fault or emergency stop")
        if self._volts and status.volts is not None:
            raws[self._volts.name] = self._volts.to_raw(status.volts)
        if self._count:
            raws[self._count.name] = count % (int(self._count.high) + 1)
        return raws

    def _raw_mode(self, mode: Mode) -> Raw:
        if mode == "unknown":
            return _unused(self._mode, tuple(self._modes))
        for raw, meaning in self._modes.items():
            if meaning == mode:
                return raw
        raise UsageError(f"names no mode value for {mode}")

    def _raw_condition(self, condition: Signal, status: BaseStatus) -> Raw:
        if status.emergency_stop:
            if not self._state.emergency_stop:
                raise UsageError("names no value for an emergency stop")
            return self._state.emergency_stop[0]
        if not status.fault:
            return self._state.ok[0]
        return _unused(condition, self._state.ok + self._state.emergency_stop)


def _names(names: Iterable[str]) -> str:
    """Return names once each, comma-separated; two bits of one meaning say it once."""
    return ", ".join(filter(None, dict.fromkeys(names)))


def _bits(names: dict[int, str], said: str) -> set[int]:
    """Return the first bit of each name that is said."""
    first = {name: bit for bit, name in reversed(names.items()) if name}
    return {first[name] for name in said.split(", ") if name in first}


def _unused(signal: Signal, taken: Sequence[Raw]) -> Raw:
    """Return the first number that a signal can say and that has no meaning."""
    for raw in range(int(signal.low), int(signal.high) + 1):
        if raw not in taken:
            return raw
    raise UsageError(f"every value of {signal.name} has a meaning")


def worst(statuses: Sequence[BaseStatus]) -> BaseStatus:
    """Return what several axes amount to: the least good mode, every fault, the lowest voltage."""
    if len(statuses) == 1:
        return statuses[0]
    lead = min(statuses, key=lambda status: _WORST_FIRST.index(status.mode))
    faults, warnings = (
        _names(name for said in column for name in said.split(", "))
        for column in zip(*((status.fault, status.warning) for status in statuses), strict=True)
    )
    return BaseStatus(
        mode=lead.mode,
        mode_name=lead.mode_name,
        emergency_stop=any(status.emergency_stop for status in statuses),
        fault=faults,
        warning=warnings,
        volts=min((status.volts for status in statuses if status.volts is not None), default=None),
        count=lead.count,
    )
