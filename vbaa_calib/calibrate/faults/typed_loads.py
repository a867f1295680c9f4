"""Typed loads: the usual slips in a row of loads.csv, and rows that are impossible before anything is solved."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.session import Load, NominalAntenna

_G = 9.80665
_UNITS = (
    ("in grams", 1e-3 * _G),
    ("in kilograms", _G),
    ("in millinewtons", 1e-3),
    ("multiplied by 9.81 twice", 1 / _G),
    ("a decimal place too small", 10.0),
    ("a decimal place too large", 0.1),
)
"""What a force may have been given in, and the factor that makes newtons of it; the commonest first."""
_LENGTHS = (
    ("in centimetres", 1e-2),
    ("in millimetres", 1e-3),
    ("a decimal place too small", 10.0),
    ("a decimal place too large", 0.1),
)
_TURNS = (
    ("with its sign turned round", (-1, 0, 0, -1)),
    ("with the sign of y turned round", (-1, 0, 0, 1)),
    ("with the sign of z turned round", (1, 0, 0, -1)),
    ("with y and z exchanged", (0, 1, 1, 0)),
    ("with y and z exchanged, and the sign turned round", (0, -1, -1, 0)),
    ("with y and z exchanged, and the sign of one of them turned round", (0, 1, -1, 0)),
    ("with y and z exchanged, and the sign of one of them turned round", (0, -1, 1, 0)),
)
"""Wrong directions of a force, and the matrix (yy, yz, zy, zz) that puts each right."""
_SAME = 1e-6
_TOO_STEEP_RAD = 1.2
"""Slope at the load, by the nominal antenna's linear beam, that nobody hangs on purpose."""
_TOO_FLAT_RAD = 1e-3
"""Slope that no picture shows well: a tenth of a millimetre at 150 mm."""
_LIKELY_RAD = 0.2


@dataclass(frozen=True)
class Entry:
    """What a row may have meant.

    what : "force" or "distance". how : the slip, to be read after "given". load : as it should have been.
    """

    what: str
    how: str
    load: Load

    @property
    def name(self) -> str:
        """The same for the same slip."""
        return f"{self.what} {self.how}"

    @property
    def is_turn(self) -> bool:
        """Whether only the force's direction differs."""
        return any(self.how == how for how, _ in _TURNS)

    def question(self, noted: Load) -> str:
        """What was typed, in the words that it was meant in."""
        if self.what == "distance":
            size = 1e3 * self.load.distance_m
            return f"{size:.4g} mm from the clamp that was typed as distance_m {noted.distance_m:.4g}"
        if self.is_turn:
            y, z = self.load.force_y_N, self.load.force_z_N
            return f"({y:.4g}, {z:.4g}) N in (y, z) that was typed as ({noted.force_y_N:.4g}, {noted.force_z_N:.4g})"
        typed, meant = _force_N(noted), _force_N(self.load)
        return f"{1e3 * meant / _G:.4g} g, which is {meant:.4g} N, that was typed as {typed:.4g} newtons"

    def remedy(self, noted: Load) -> str:
        """The cells that would fit."""
        if self.what == "distance":
            return f"distance_m {noted.distance_m:.4g} → {self.load.distance_m:.4g}"
        old, new = noted, self.load
        pairs = (("force_y_N", old.force_y_N, new.force_y_N), ("force_z_N", old.force_z_N, new.force_z_N))
        size = max(abs(value) for _, *values in pairs for value in values)
        return ", ".join(f"{name} {a:.4g} → {b:.4g}" for name, a, b in pairs if abs(a - b) > _SAME * size)


def other_entries(load: Load, length_m: float) -> list[Entry]:
    """Everything else that a row could have meant, one slip at a time."""

    y, z, at = load.force_y_N, load.force_z_N, load.distance_m
    forces = [(how, (factor * y, factor * z)) for how, factor in _UNITS]
    known = [(y, z)]
    for how, (yy, yz, zy, zz) in _TURNS:
        turned = yy * y + yz * z, zy * y + zz * z
        if all(abs(turned[0] - a) + abs(turned[1] - b) > _SAME * (abs(y) + abs(z)) for a, b in known):
            known.append(turned)
            forces.append((how, turned))
    places = [(how, factor * at) for how, factor in _LENGTHS if 0 < factor * at <= length_m]
    if length_m - at > _SAME and abs(length_m - 2 * at) > 0.02 * length_m:
        places.append(("from the tip", length_m - at))
    found = [Entry("force", how, replace(load, force_y_N=y, force_z_N=z)) for how, (y, z) in forces]
    found[len(_UNITS) : len(_UNITS)] = [Entry("distance", how, replace(load, distance_m=x)) for how, x in places]
    return found


def row_name(index: int, load: Load) -> str:
    """Name of a row of loads.csv, its first load being row 1."""
    return f"row {index + 1}" + (f" ({load.image.name})" if load.image else "")


def rows_name(rows: Sequence[tuple[int, Load]], count: int = 0) -> str:
    """Name of several rows of loads.csv, which has `count` loads; 0: unknown."""
    if len(rows) == count > 1:
        return f"all {count} rows of loads.csv"
    more = f" and {len(rows) - 4} more" if len(rows) > 4 else ""
    return "loads.csv " + ", ".join(row_name(index, load) for index, load in rows[:4]) + more


def _force_N(load: Load) -> float:
    return math.hypot(load.force_y_N, load.force_z_N)


def typed_load_diagnoses(loads: Sequence[Load], antenna: NominalAntenna) -> list[Diagnosis]:
    """Typed loads that are impossible by the nominal antenna alone."""
    rows = list(enumerate(loads))
    return _distances(rows, antenna) + _forces(rows, antenna)


def _distances(rows: Sequence[tuple[int, Load]], antenna: NominalAntenna) -> list[Diagnosis]:
    beyond = [(index, load) for index, load in rows if not 0 < load.distance_m <= antenna.length_m]
    if not beyond:
        return []
    at, length_m = beyond[0][1].distance_m, antenna.length_m
    units = [how for how, factor in _LENGTHS[:2] if 0.02 * length_m < factor * at <= length_m]
    guess = f"was it given {' or '.join(units)}? " if units else ""
    return [
        Diagnosis(
            "load_distance_unit",
            f"{rows_name(beyond, len(rows))}: distance_m is {at:.4g}, the antenna is {length_m:g} m long",
            f"{guess}Give metres from the clamp along the antenna",
            grave=True,
        )
    ]


def _forces(rows: Sequence[tuple[int, Load]], antenna: NominalAntenna) -> list[Diagnosis]:
    found, length_m = [], antenna.length_m
    inside = [(index, load) for index, load in rows if 0 < load.distance_m <= length_m]

    def slope_rad(row: tuple[int, Load]) -> float:
        """At the load, by the linear beam: f·l²/2EI."""
        return _force_N(row[1]) * row[1].distance_m ** 2 / (2.0 * antenna.stiffness_Nm2)

    def described(row: tuple[int, Load], which: Sequence[tuple[int, Load]], digits: str) -> tuple[str, float]:
        """The rows' name with one of them, and how far its tip would move, mm."""
        load = row[1]
        tip_mm = 1e3 * slope_rad(row) * (length_m - load.distance_m / 3)
        name = rows_name(which, len(rows))
        return f"{name}: {_force_N(load):.4g} N at {1e3 * load.distance_m:{digits}} mm would", tip_mm

    steep = [row for row in inside if slope_rad(row) > _TOO_STEEP_RAD]
    if steep:
        worst = max(steep, key=slope_rad)
        likely = [(how, f) for how, f in _UNITS[:3] if 0.01 < f * slope_rad(worst) < _TOO_STEEP_RAD / 2]
        likely.sort(key=lambda unit: abs(np.log(unit[1] * slope_rad(worst) / _LIKELY_RAD)))
        guess = " or ".join(f"{how} it would be {factor * _force_N(worst[1]):.3g} N" for how, factor in likely)
        words, tip_mm = described(worst, steep, ".0f")
        words += (
            f" bend an antenna of EI {antenna.stiffness_Nm2:.3g} N·m² aside by {tip_mm:.0f} mm, and it is "
            f"{1e3 * length_m:.0f} mm long"
        )
        remedy = (f"given {guess}. " if guess else "") + "Give newtons (grams · 0.00981), or check the diameter"
        found.append(Diagnosis("load_force_unit", words, remedy, grave=True))
    flat = [row for row in inside if slope_rad(row) < _TOO_FLAT_RAD]
    if flat:
        words, tip_mm = described(min(flat, key=slope_rad), flat, ".3g")
        remedy = "give newtons, not kilonewtons or kilograms, and metres; or hang more weight farther out"
        found.append(Diagnosis("load_too_small", f"{words} move the tip by {tip_mm:.2g} mm only", remedy))
    return found
