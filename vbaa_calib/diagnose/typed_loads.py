"""Typed loads that are impossible by the nominal antenna alone, before any picture is taken."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.session import STANDARD_GRAVITY_M_S2 as _G
from vbaa_calib.session import Load, NominalAntenna

FORCE_UNITS = (
    ("in grams", 1e-3 * _G),
    ("in kilograms", _G),
    ("in millinewtons", 1e-3),
    ("in pounds", 4.4482),
    ("in ounces", 0.27801),
    ("multiplied by 9.81 twice", 1 / _G),
    ("a decimal place too small", 10.0),
    ("a decimal place too large", 0.1),
)
"""What a force may have been reported in, and the factor that makes newtons of it; the commonest first."""
LENGTH_UNITS = (
    ("in centimetres", 1e-2),
    ("in millimetres", 1e-3),
    ("in inches", 0.0254),
    ("a decimal place too small", 10.0),
    ("a decimal place too large", 0.1),
)
"""The same of a distance, in metres."""


def weighed(load: Load) -> float:
    """Magnitude of a load's force, N."""
    return float(np.hypot(load.force_y_N, load.force_z_N))


def rows_name(rows: Sequence[tuple[int, Load]], count: int = 0) -> str:
    """Name of several rows of loads.csv (counted from 1 there), which has `count` loads; 0 if that is unknown."""
    if len(rows) == count > 1:
        return f"all {count} rows of loads.csv"
    names = [f"row {index + 1}" + (f" ({load.image.name})" if load.image else "") for index, load in rows[:4]]
    return "loads.csv " + ", ".join(names) + (f" and {len(rows) - 4} more" if len(rows) > 4 else "")


def typed_load_diagnoses(loads: Sequence[Load], antenna: NominalAntenna) -> list[Diagnosis]:
    """Diagnoses of typed loads that are impossible for the nominal antenna."""
    # slopes at a load, by the linear beam, that nobody bends an antenna by on purpose, and that no picture resolves
    # well: a tenth of a millimetre at 150 mm
    steep_rad, flat_rad = 1.2, 1e-3
    rows, length_m, found = list(enumerate(loads)), antenna.length_m, []
    inside = [(index, load) for index, load in rows if 0 < load.distance_m <= length_m]
    beyond = [row for row in rows if row not in inside]
    if beyond:
        at = beyond[0][1].distance_m
        units = [how for how, factor in LENGTH_UNITS[:2] if 0.02 * length_m < factor * at <= length_m]
        guess = f"was it given {' or '.join(units)}? " if units else ""
        words = f"{rows_name(beyond, len(rows))}: distance_m is {at:.4g}, the antenna is {length_m:g} m long"
        remedy = f"{guess}Give metres from the clamp along the antenna"
        found.append(Diagnosis("load_distance_unit", words, remedy, "wrong"))

    def slope_rad(row: tuple[int, Load]) -> float:
        """Slope at the load by the linear beam: f·l²/2EI."""
        at_m = row[1].distance_m
        softer = float(antenna.taper.turning(np.array(at_m / length_m)))
        return weighed(row[1]) * at_m**2 * softer / (2.0 * antenna.stiffness_Nm2)

    def described(row: tuple[int, Load], which: Sequence[tuple[int, Load]], digits: str) -> tuple[str, float]:
        """Words for rows with an impossible load, with one of them as the example, and the displacement of its tip, mm,
        that the linear beam predicts."""
        load, tip_mm = row[1], 1e3 * slope_rad(row) * (length_m - row[1].distance_m / 3)
        name = rows_name(which, len(rows))
        return f"{name}: {weighed(load):.4g} N at {1e3 * load.distance_m:{digits}} mm would", tip_mm

    steep = [row for row in inside if slope_rad(row) > steep_rad]
    if steep:
        worst = max(steep, key=slope_rad)
        likely = [(how, f) for how, f in FORCE_UNITS[:3] if 0.01 < f * slope_rad(worst) < steep_rad / 2]
        likely.sort(key=lambda unit: abs(np.log(unit[1] * slope_rad(worst) / 0.2)))
        guess = " or ".join(f"{how} it would be {factor * weighed(worst[1]):.3g} N" for how, factor in likely)
        words, tip_mm = described(worst, steep, ".0f")
        words += (
            f" bend an antenna of EI {antenna.stiffness_Nm2:.3g} N·m² aside by {tip_mm:.0f} mm, and it is "
            f"{1e3 * length_m:.0f} mm long"
        )
        remedy = (f"given {guess}. " if guess else "") + "Give newtons (grams · 0.00981), or check the diameter"
        found.append(Diagnosis("load_force_unit", words, remedy, "wrong"))
    flat = [row for row in inside if slope_rad(row) < flat_rad]
    if flat:
        words, tip_mm = described(min(flat, key=slope_rad), flat, ".3g")
        remedy = "give newtons, not kilonewtons or kilograms, and metres; or hang more weight farther out"
        found.append(Diagnosis("load_too_small", f"{words} move the tip by {tip_mm:.2g} mm only", remedy))
    return found
