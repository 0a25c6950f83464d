"""Maps one message of a role between quantities in SI units and raw signals."""

from __future__ import annotations

from dataclasses import dataclass

from adatracker_deploy.core.errors import UsageError
from adatracker_wheeled.protocol.dbc import Layout, Raw, Signal
from adatracker_wheeled.protocol.roles import WHEEL_ANGLES, Fixed, Linked, Scaled, Wheels, at_rim

Quantities = dict[str, float]
"""Values by their name in `roles`, wheels in metres of the rim."""


@dataclass(frozen=True, slots=True)
class Link:
    """A quantity and its signal: quantity = factor x the signal's value."""

    quantity: str
    signal: Signal
    factor: float

    def to_raw(self, quantity: float) -> Raw:
        """Return the nearest raw number."""
        return self.signal.to_raw(quantity / self.factor)

    def to_quantity(self, raw: Raw) -> float:
        """Return the quantity that a raw number means."""
        return self.factor * self.signal.to_value(raw)

    @property
    def span(self) -> tuple[float, float]:
        """The least and the greatest quantity."""
        low, high = (self.factor * end for end in self.signal.span)
        return min(low, high), max(low, high)

    @property
    def wrap(self) -> float | None:
        """After how much a counter starts over; None for an IEEE 754 signal, which does not."""
        if self.signal.float_format is not None:
            return None
        return (self.signal.high - self.signal.low + 1) * abs(self.signal.scale * self.factor)

    def wrapped(self, quantity: float) -> float:
        """Return what a counter shows after it has started over as often as `quantity` needs."""
        low, _ = self.span
        return quantity if self.wrap is None else low + (quantity - low) % self.wrap


@dataclass(frozen=True, slots=True)
class Part:
    """A message, what it carries, and what always stands in it."""

    layout: Layout
    links: tuple[Link, ...]
    constants: dict[str, Raw]
    counter: Signal | None

    @classmethod
    def of(cls, described: Linked | Fixed, layout: Layout, wheels: Wheels | None) -> Part:
        """Look a described message's signals up.

        Raises:
            UsageError: a signal is missing, or cannot be what is asked of it.
        """
        linked = described.signals.items() if isinstance(described, Linked) else ()
        fixed = described.constants if isinstance(described, Linked) else described.values
        return cls(
            layout=layout,
            links=tuple(_link(quantity, to, layout, wheels) for quantity, to in linked),
            constants={name: _exact(layout, name, value) for name, value in fixed.items()},
            counter=layout.signal(described.counter) if described.counter else None,
        )

    def write(self, values: Quantities, count: int) -> dict[str, Raw]:
        """Return the signals that say `values`, clipped and rounded; what `values` lacks is zero."""
        raws = {link.signal.name: link.to_raw(values.get(link.quantity, 0.0)) for link in self.links}
        raws |= self.constants
        if self.counter is not None:
            raws[self.counter.name] = count % (int(self.counter.high) + 1)
        return raws

    def matches(self, raws: dict[str, Raw]) -> bool:
        """Return whether a frame has this part's meaning: its constants stand in it."""
        return all(raws[name] == value for name, value in self.constants.items())

    def read(self, raws: dict[str, Raw]) -> Quantities:
        """Return the quantities in a frame."""
        return {link.quantity: link.to_quantity(raws[link.signal.name]) for link in self.links}


def _link(quantity: str, to: str | Scaled, layout: Layout, wheels: Wheels | None) -> Link:
    name, factor = (to.signal, to.scale) if isinstance(to, Scaled) else (to, 1.0)
    if factor == 0:
        raise UsageError(f"{layout.dbc}: {layout.name}.{name}: scale must not be 0")
    if quantity in WHEEL_ANGLES and wheels is not None and wheels.radius_m is not None:
        factor *= WHEEL_ANGLES[quantity][1] * wheels.radius_m
    return Link(at_rim(quantity), layout.signal(name), factor)


def _exact(layout: Layout, name: str, value: float) -> Raw:
    signal = layout.signal(name)
    raw = signal.exact(value)
    if raw is None:
        low, high = signal.span
        raise UsageError(
            f"{layout.dbc}: {layout.name}.{name} is never {value:g}; it reaches from {low:g} to {high:g}"
        )
    return raw
