"""What is odd about typed loads before anything is solved: they would bend the antenna too far, or not at all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.session import Load, NominalAntenna

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


TOO_STEEP_RAD = 1.2
"""Slope at the load, by the nominal antenna's linear beam, that nobody hangs on purpose."""
TOO_FLAT_RAD = 1e-3
"""Slope that no picture shows well: a tenth of a millimetre at 150 mm."""
LIKELY_RAD = 0.2
OFF_GRAVITY = np.deg2rad(15.0)


def typed_load_doubts(
    loads: Sequence[Load],
    antenna: NominalAntenna,
    gravity_m_s2: np.ndarray | None = None,
    hung: bool = False,
) -> list[Diagnosis]:
    """What typed loads cannot mean, by the nominal antenna alone.

    Parameters
    ----------
    gravity_m_s2 : (F, 3) antenna frame, in each load's picture; asked for only where weights were hung.
    hung : the loads are weights that hang straight down, rather than threads over pulleys.
    """
    found = _distances(loads, antenna) + _forces(loads, antenna)
    if hung and gravity_m_s2 is not None:
        found += _directions(loads, np.asarray(gravity_m_s2, float).reshape(-1, 3))
    return found


def _slope_rad(load: Load, antenna: NominalAntenna) -> float:
    """Slope at the load by the linear beam, f·l²/2EI."""
    return _force_N(load) * load.distance_m**2 / (2.0 * antenna.stiffness_Nm2)


def _force_N(load: Load) -> float:
    return float(np.hypot(load.force_y_N, load.force_z_N))


def _rows(which: Sequence[int], loads: Sequence[Load]) -> str:
    if len(which) == len(loads) > 1:
        return f"all {len(loads)} rows of loads.csv"
    names = [row_name(index, loads[index]) for index in which[:4]]
    return "loads.csv " + ", ".join(names) + (f" and {len(which) - 4} more" if len(which) > 4 else "")


def _distances(loads: Sequence[Load], antenna: NominalAntenna) -> list[Diagnosis]:
    beyond = [index for index, load in enumerate(loads) if not 0 < load.distance_m <= antenna.length_m]
    if not beyond:
        return []
    one = loads[beyond[0]]
    fits = [how for how, factor in LENGTHS[:2] if 0.02 * antenna.length_m < factor * one.distance_m <= antenna.length_m]
    guess = f"was it given {' or '.join(fits)}? " if fits else ""
    return [
        Diagnosis(
            "load_distance_unit",
            f"{_rows(beyond, loads)}: distance_m is {one.distance_m:.4g}, the antenna is {antenna.length_m:g} m long",
            f"{guess}Give metres from the clamp along the antenna",
            grave=True,
        )
    ]


def _forces(loads: Sequence[Load], antenna: NominalAntenna) -> list[Diagnosis]:
    found = []
    inside = [index for index, load in enumerate(loads) if 0 < load.distance_m <= antenna.length_m]
    slopes = {index: _slope_rad(loads[index], antenna) for index in inside}
    steep = [index for index in inside if slopes[index] > TOO_STEEP_RAD]
    if steep:
        index = max(steep, key=lambda one: slopes[one])
        one = loads[index]
        likely = [(how, factor) for how, factor in UNITS[:3] if 0.01 < factor * slopes[index] < TOO_STEEP_RAD / 2]
        likely.sort(key=lambda unit: abs(np.log(unit[1] * slopes[index] / LIKELY_RAD)))
        guess = " or ".join(f"{how} it would be {factor * _force_N(one):.3g} N" for how, factor in likely)
        tip_m = slopes[index] * (antenna.length_m - one.distance_m / 3)
        found.append(
            Diagnosis(
                "load_force_unit",
                f"{_rows(steep, loads)}: {_force_N(one):.4g} N at {1e3 * one.distance_m:.0f} mm would bend an antenna "
                f"of EI {antenna.stiffness_Nm2:.3g} N·m² aside by {1e3 * tip_m:.0f} mm, and it is "
                f"{1e3 * antenna.length_m:.0f} mm long",
                (f"given {guess}. " if guess else "") + "Give newtons (grams · 0.00981), or check the diameter",
                grave=True,
            )
        )
    flat = [index for index in inside if slopes[index] < TOO_FLAT_RAD]
    if flat:
        index = min(flat, key=lambda one: slopes[one])
        one = loads[index]
        tip_m = slopes[index] * (antenna.length_m - one.distance_m / 3)
        found.append(
            Diagnosis(
                "load_too_small",
                f"{_rows(flat, loads)}: {_force_N(one):.4g} N at {1e3 * one.distance_m:.3g} mm would move the tip by "
                f"{1e3 * tip_m:.2g} mm only",
                "give newtons, not kilonewtons or kilograms, and metres; or hang more weight farther out",
            )
        )
    return found


def _directions(loads: Sequence[Load], gravity: np.ndarray) -> list[Diagnosis]:
    off, along = [], []
    for index, (load, pull) in enumerate(zip(loads, gravity, strict=True)):
        size, force = float(np.linalg.norm(pull)), np.array([load.force_y_N, load.force_z_N])
        if size == 0:
            continue
        if abs(pull[0]) > np.sin(OFF_GRAVITY) * size:
            along.append(index)
        elif float(force @ pull[1:]) < np.cos(OFF_GRAVITY) * float(np.linalg.norm(force)) * size:
            off.append(index)
    found = []
    if off:
        load, pull = loads[off[0]], gravity[off[0]]
        right = _force_N(load) * pull[1:] / np.linalg.norm(pull[1:])
        found.append(
            Diagnosis(
                "load_not_along_gravity",
                f"{_rows(off, loads)}: the force ({load.force_y_N:.4g}, {load.force_z_N:.4g}) N does not point down, "
                f"though weights hang; down is ({pull[1]:.3g}, {pull[2]:.3g}) m/s² in (y, z)",
                f"give force_y_N {right[0]:.4g}, force_z_N {right[1]:.4g}, or check gravity_world and the joints",
                grave=True,
            )
        )
    if along:
        lean = np.degrees(np.arcsin(min(1.0, abs(gravity[along[0]][0]) / float(np.linalg.norm(gravity[along[0]])))))
        found.append(
            Diagnosis(
                "load_along_antenna",
                f"{_rows(along, loads)}: the antenna stands {lean:.0f}° off level, so that the weight pulls along it",
                "hang weights on a level antenna: loads.csv holds forces across it only",
                grave=True,
            )
        )
    return found
