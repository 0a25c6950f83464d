"""The 24 people that ship: who they are and what they wear."""

from __future__ import annotations

from dataclasses import dataclass

from people.base_mesh import Shape
from people.wardrobe import Outfit, Paint, Rgb


@dataclass(frozen=True, slots=True, kw_only=True)
class Person:
    """One of them."""

    name: str
    shape: Shape
    outfit: Outfit
    arms: float = 1.0
    """Swing of the arms, times the usual."""
    stoop_deg: float = 2.0


_PALE: Rgb = (0.91, 0.74, 0.64)
_LIGHT: Rgb = (0.84, 0.65, 0.53)
_OLIVE: Rgb = (0.73, 0.55, 0.41)
_BROWN: Rgb = (0.52, 0.36, 0.26)
_DARK: Rgb = (0.33, 0.22, 0.16)
_BLACK: Rgb = (0.06, 0.055, 0.06)
_NAVY: Rgb = (0.10, 0.14, 0.27)
_DENIM: Rgb = (0.22, 0.31, 0.46)
_GREY: Rgb = (0.42, 0.43, 0.45)
_CHARCOAL: Rgb = (0.17, 0.17, 0.19)
_KHAKI: Rgb = (0.56, 0.49, 0.36)
_WHITE: Rgb = (0.90, 0.90, 0.88)
_CREAM: Rgb = (0.86, 0.80, 0.68)
_RED: Rgb = (0.70, 0.12, 0.13)
_MAROON: Rgb = (0.36, 0.09, 0.13)
_ORANGE: Rgb = (0.86, 0.40, 0.10)
_YELLOW: Rgb = (0.88, 0.73, 0.18)
_GREEN: Rgb = (0.16, 0.40, 0.24)
_OLIVE_DRAB: Rgb = (0.29, 0.31, 0.18)
_TEAL: Rgb = (0.10, 0.42, 0.44)
_BLUE: Rgb = (0.15, 0.33, 0.66)
_SKY: Rgb = (0.55, 0.70, 0.86)
_PURPLE: Rgb = (0.36, 0.18, 0.46)
_PINK: Rgb = (0.86, 0.55, 0.62)
_TAN: Rgb = (0.66, 0.50, 0.33)


def _plain(rgb: Rgb) -> Paint:
    return Paint(rgb=rgb)


CAST: tuple[Person, ...] = (
    Person(
        name="anders",
        shape=Shape(man=1.0, muscle=0.55, weight=0.5, height_m=1.88),
        outfit=Outfit(skin=_PALE, hair=(0.62, 0.47, 0.28), top=_plain(_NAVY), legs=_plain(_DENIM)),
    ),
    Person(
        name="amara",
        shape=Shape(man=0.0, african=1.0, weight=0.55, height_m=1.68),
        outfit=Outfit(
            skin=_DARK,
            hair=_BLACK,
            top=_plain(_YELLOW),
            sleeves="short",
            legs=_plain(_DARK),
            legs_to="bare",
            skirt=Paint(rgb=_TEAL, other=_YELLOW, pattern="stripes", size_m=0.18),
            shoes=(0.35, 0.22, 0.14),
        ),
    ),
    Person(
        name="bela",
        shape=Shape(man=1.0, old=0.75, weight=0.75, muscle=0.4, height_m=1.72),
        outfit=Outfit(
            skin=_LIGHT,
            hair=(0.72, 0.71, 0.70),
            top=Paint(rgb=_OLIVE_DRAB, other=_CREAM, pattern="front"),
            loose_m=0.02,
            legs=_plain(_KHAKI),
            shoes=(0.28, 0.19, 0.13),
        ),
        arms=0.6,
        stoop_deg=9.0,
    ),
    Person(
        name="chen",
        shape=Shape(man=1.0, asian=1.0, weight=0.4, height_m=1.74),
        outfit=Outfit(
            skin=_OLIVE,
            hair=_BLACK,
            top=_plain(_WHITE),
            sleeves="short",
            legs=_plain(_BLACK),
            shoes=(0.85, 0.85, 0.86),
            bag=_CHARCOAL,
        ),
    ),
    Person(
        name="dana",
        shape=Shape(man=0.0, weight=0.45, height_m=1.75),
        outfit=Outfit(
            skin=_LIGHT,
            hair=(0.30, 0.18, 0.10),
            hair_style="long",
            top=_plain(_WHITE),
            legs=_plain(_BLACK),
            coat=_plain(_TAN),
            coat_to=0.52,
            shoes=_BLACK,
        ),
    ),
    Person(
        name="emeka",
        shape=Shape(man=1.0, african=1.0, muscle=0.75, weight=0.5, height_m=1.92),
        outfit=Outfit(
            skin=_DARK,
            hair=_BLACK,
            hair_style="bald",
            top=_plain(_RED),
            sleeves="short",
            legs=_plain(_CHARCOAL),
            legs_to="knee",
            shoes=_WHITE,
        ),
        arms=1.15,
    ),
    Person(
        name="fatima",
        shape=Shape(man=0.0, african=0.4, weight=0.65, height_m=1.62),
        outfit=Outfit(
            skin=_OLIVE,
            hair=_BLACK,
            hair_style="hood",
            top=_plain(_PURPLE),
            loose_m=0.022,
            legs=_plain(_BLACK),
            skirt=_plain(_BLACK),
            skirt_to=0.12,
        ),
        arms=0.7,
    ),
    Person(
        name="george",
        shape=Shape(man=1.0, weight=0.9, muscle=0.45, height_m=1.80, old=0.3),
        outfit=Outfit(
            skin=_PALE,
            hair=(0.42, 0.27, 0.16),
            top=Paint(rgb=_SKY, other=_WHITE, pattern="checks", size_m=0.10),
            loose_m=0.018,
            legs=_plain(_NAVY),
        ),
    ),
    Person(
        name="hana",
        shape=Shape(man=0.0, asian=1.0, weight=0.35, height_m=1.56),
        outfit=Outfit(
            skin=_LIGHT,
            hair=_BLACK,
            hair_style="long",
            top=_plain(_PINK),
            legs=_plain(_GREY),
            shoes=_WHITE,
            bag=_RED,
        ),
    ),
    Person(
        name="ines",
        shape=Shape(man=0.0, weight=0.5, height_m=1.66, old=0.15),
        outfit=Outfit(
            skin=_OLIVE,
            hair=(0.16, 0.10, 0.07),
            top=Paint(rgb=_WHITE, other=_NAVY, pattern="stripes", size_m=0.10),
            legs=_plain(_DENIM),
            shoes=_RED,
        ),
    ),
    Person(
        name="jonas",
        shape=Shape(man=1.0, weight=0.35, muscle=0.4, height_m=1.95),
        outfit=Outfit(
            skin=_PALE,
            hair=(0.50, 0.24, 0.11),
            top=_plain(_GREEN),
            loose_m=0.022,
            legs=_plain(_CHARCOAL),
            shoes=_ORANGE,
        ),
        arms=1.2,
    ),
    Person(
        name="kavita",
        shape=Shape(man=0.0, asian=0.3, african=0.2, weight=0.6, height_m=1.60, old=0.4),
        outfit=Outfit(
            skin=_BROWN,
            hair=_BLACK,
            hair_style="long",
            top=Paint(rgb=_ORANGE, other=_MAROON, pattern="yoke"),
            legs=_plain(_MAROON),
            skirt=_plain(_ORANGE),
            skirt_to=0.3,
            shoes=(0.45, 0.30, 0.18),
        ),
    ),
    Person(
        name="luis",
        shape=Shape(man=1.0, african=0.2, asian=0.2, weight=0.6, height_m=1.66),
        outfit=Outfit(
            skin=_OLIVE,
            hair=_BLACK,
            hair_style="cap",
            top=_plain(_BLUE),
            sleeves="short",
            legs=_plain(_KHAKI),
            legs_to="knee",
            shoes=_WHITE,
        ),
    ),
    Person(
        name="maria",
        shape=Shape(man=0.0, old=0.8, weight=0.7, height_m=1.55),
        outfit=Outfit(
            skin=_LIGHT,
            hair=(0.80, 0.79, 0.78),
            top=_plain(_PURPLE),
            legs=_plain(_CHARCOAL),
            coat=_plain(_GREY),
            coat_to=0.6,
        ),
        arms=0.55,
        stoop_deg=10.0,
    ),
    Person(
        name="noor",
        shape=Shape(man=0.0, african=0.5, muscle=0.6, weight=0.4, height_m=1.72),
        outfit=Outfit(
            skin=_BROWN,
            hair=_BLACK,
            top=_plain(_BLACK),
            sleeves="none",
            loose_m=0.008,
            legs=_plain(_BLACK),
            shoes=_PINK,
        ),
        arms=1.2,
    ),
    Person(
        name="oscar",
        shape=Shape(man=1.0, weight=0.55, old=0.5, height_m=1.78),
        outfit=Outfit(
            skin=_LIGHT,
            hair=(0.45, 0.43, 0.41),
            top=_plain(_WHITE),
            legs=_plain(_CHARCOAL),
            coat=Paint(rgb=_CHARCOAL, other=_WHITE, pattern="front"),
            coat_to=0.85,
            shoes=_BLACK,
        ),
    ),
    Person(
        name="petra",
        shape=Shape(man=0.0, weight=0.5, height_m=1.80),
        outfit=Outfit(
            skin=_PALE,
            hair=(0.80, 0.66, 0.40),
            hair_style="long",
            top=_plain(_TEAL),
            legs=_plain(_CREAM),
            shoes=_TAN,
        ),
    ),
    Person(
        name="qadir",
        shape=Shape(man=1.0, african=0.1, weight=0.5, height_m=1.76),
        outfit=Outfit(
            skin=_OLIVE,
            hair=_BLACK,
            top=Paint(rgb=_BLACK, other=_GREY, pattern="yoke"),
            loose_m=0.02,
            legs=_plain(_OLIVE_DRAB),
            bag=_OLIVE_DRAB,
        ),
    ),
    Person(
        name="rosa",
        shape=Shape(man=0.0, weight=0.85, height_m=1.63, old=0.25),
        outfit=Outfit(
            skin=_BROWN,
            hair=(0.12, 0.08, 0.06),
            hair_style="long",
            top=_plain(_RED),
            sleeves="short",
            legs=_plain(_DENIM),
        ),
    ),
    Person(
        name="sven",
        shape=Shape(man=1.0, muscle=0.7, weight=0.6, height_m=1.84, old=0.2),
        outfit=Outfit(
            skin=_PALE,
            hair=(0.55, 0.36, 0.17),
            hair_style="cap",
            top=_plain(_ORANGE),
            loose_m=0.028,
            legs=Paint(rgb=_NAVY, other=_GREY, pattern="plain"),
            shoes=(0.25, 0.18, 0.12),
        ),
    ),
    Person(
        name="tomo",
        shape=Shape(man=1.0, asian=1.0, weight=0.55, old=0.6, height_m=1.64),
        outfit=Outfit(
            skin=_LIGHT,
            hair=(0.35, 0.34, 0.34),
            top=_plain(_GREY),
            legs=_plain(_GREY),
            shoes=_BLACK,
        ),
        arms=0.8,
    ),
    Person(
        name="ugo",
        shape=Shape(man=1.0, weight=0.45, height_m=1.70),
        outfit=Outfit(
            skin=_OLIVE,
            hair=(0.10, 0.08, 0.07),
            top=Paint(rgb=_MAROON, other=_CREAM, pattern="stripes", size_m=0.14),
            legs=_plain(_BLACK),
            shoes=_WHITE,
        ),
    ),
    Person(
        name="vera",
        shape=Shape(man=0.0, weight=0.3, height_m=1.70),
        outfit=Outfit(
            skin=_PALE,
            hair=(0.58, 0.22, 0.10),
            hair_style="long",
            top=_plain(_BLACK),
            legs=_plain((0.15, 0.13, 0.13)),
            skirt=_plain(_BLACK),
            skirt_to=0.62,
            shoes=_BLACK,
        ),
    ),
    Person(
        name="wale",
        shape=Shape(man=1.0, african=1.0, weight=0.4, height_m=1.82),
        outfit=Outfit(
            skin=_BROWN,
            hair=_BLACK,
            top=Paint(rgb=_NAVY, other=_RED, pattern="checks", size_m=0.16),
            legs=_plain(_DENIM),
            shoes=_YELLOW,
        ),
    ),
)
