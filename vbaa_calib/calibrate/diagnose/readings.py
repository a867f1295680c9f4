"""Ways in which a load's row gets written down wrong, and what the row would then have to say."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ...session import Load

G = 9.80665
UNITS = (
    ("in grams", 1e-3 * G),
    ("in kilograms", G),
    ("in millinewtons", 1e-3),
    ("multiplied by 9.81 twice", 1 / G),
    ("a decimal place too small", 10.0),
    ("a decimal place too large", 0.1),
)
"""What a force may have been given in, and the factor that makes newtons of it; the commonest first."""
LENGTHS = (("in centimetres", 1e-2), ("in millimetres", 1e-3), ("a decimal place too small", 10.0))
LENGTHS_SMALL = (("a decimal place too large", 0.1),)
TURNS = (
    ("with its sign turned round", (-1, 0, 0, -1)),
    ("with the sign of y turned round", (-1, 0, 0, 1)),
    ("with the sign of z turned round", (1, 0, 0, -1)),
    ("with y and z exchanged", (0, 1, 1, 0)),
    ("with y and z exchanged, and the sign turned round", (0, -1, -1, 0)),
    ("with y and z exchanged, and the sign of one of them turned round", (0, 1, -1, 0)),
    ("with y and z exchanged, and the sign of one of them turned round", (0, -1, 1, 0)),
)
"""Where a force may have been given to point, and the matrix (yy, yz, zy, zz) that puts it right."""
SAME = 1e-6


@dataclass(frozen=True)
class Reading:
    """What a row may have meant.

    Attributes
    ----------
    what : "force" or "distance". how : what is wrong with it, to be read after "given". load : as it should have been.
    """

    what: str
    how: str
    load: Load

    @property
    def name(self) -> str:
        """For comparing rows: the same slip has the same name."""
        return f"{self.what} {self.how}"

    @property
    def is_turn(self) -> bool:
        """Whether the force only points elsewhere."""
        return any(self.how == how for how, _ in TURNS)

    def question(self, noted: Load) -> str:
        """What was typed, in the words that it was meant in."""
        if self.what == "distance":
            size = 1e3 * self.load.distance_m
            return f"{size:.4g} mm from the clamp that was typed as distance_m {noted.distance_m:.4g}"
        if self.is_turn:
            y, z = self.load.force_y_N, self.load.force_z_N
            return f"({y:.4g}, {z:.4g}) N in (y, z) that was typed as ({noted.force_y_N:.4g}, {noted.force_z_N:.4g})"
        typed, meant = _size_N(noted), _size_N(self.load)
        return f"{1e3 * meant / G:.4g} g, which is {meant:.4g} N, that was typed as {typed:.4g} newtons"

    def remedy(self, noted: Load) -> str:
        """The cells that would fit."""
        if self.what == "distance":
            return f"distance_m {noted.distance_m:.4g} → {self.load.distance_m:.4g}"
        old, new = noted, self.load
        pairs = (("force_y_N", old.force_y_N, new.force_y_N), ("force_z_N", old.force_z_N, new.force_z_N))
        size = max(abs(value) for _, *values in pairs for value in values)
        return ", ".join(f"{name} {a:.4g} → {b:.4g}" for name, a, b in pairs if abs(a - b) > SAME * size)


def other_readings(load: Load, length_m: float) -> list[Reading]:
    """Everything else that a row could have meant, one slip at a time."""
    y, z = load.force_y_N, load.force_z_N
    found = [Reading("force", how, _with_force(load, factor * y, factor * z)) for how, factor in UNITS]
    for how, factor in (*LENGTHS, *LENGTHS_SMALL):
        if 0 < factor * load.distance_m <= length_m:
            found.append(Reading("distance", how, replace(load, distance_m=factor * load.distance_m)))
    if length_m - load.distance_m > SAME and abs(length_m - 2 * load.distance_m) > 0.02 * length_m:
        found.append(Reading("distance", "from the tip", replace(load, distance_m=length_m - load.distance_m)))
    size = abs(y) + abs(z)
    known = [(y, z)]
    for how, (yy, yz, zy, zz) in TURNS:
        turned = yy * y + yz * z, zy * y + zz * z
        if all(abs(turned[0] - a) + abs(turned[1] - b) > SAME * size for a, b in known):
            known.append(turned)
            found.append(Reading("force", how, _with_force(load, *turned)))
    return found


def row_name(index: int, load: Load) -> str:
    """How a row of loads.csv is called, its first load being row 1."""
    return f"row {index + 1}" + (f" ({load.image.name})" if load.image else "")


def _size_N(load: Load) -> float:
    return math.hypot(load.force_y_N, load.force_z_N)


def _with_force(load: Load, y: float, z: float) -> Load:
    return replace(load, force_y_N=y, force_z_N=z)
