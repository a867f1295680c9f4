"""Reads and checks a table of measured deflections: x_m,unloaded_y_m,loaded_y_m."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import MAX_EMAX, Context, Decimal
from pathlib import Path

import numpy as np

from vbaa_calib.core.csv_rows import number, read_csv
from vbaa_calib.core.errors import InputError

from .settings import AntennaSettings

_COLUMNS = ("x_m", "unloaded_y_m", "loaded_y_m")  # of the table


@dataclass(frozen=True, eq=False)
class DeflectionTable:
    """N readings of a gauge along a clamped rod, without and with the load."""

    x_m: np.ndarray  # (N,) strictly increasing, from the clamp along the undeflected rod
    unloaded_y_m: np.ndarray  # (N,) positive in the force's direction
    loaded_y_m: np.ndarray  # (N,)
    resolution_m: float = 0.0  # the last decimal written down; 0: unknown

    @property
    def deflection_m(self) -> np.ndarray:
        """(N,) what the load added: constant errors of the gauge along x, the rod's sag and bow cancel."""
        return self.loaded_y_m - self.unloaded_y_m


def read_deflections(path: Path, force_N: float, distance_m: float) -> DeflectionTable:
    """The table of a CSV. Raises InputError naming file, line and remedy for anything that cannot be one."""
    check_load(force_N, distance_m)
    rows = read_csv(path, _COLUMNS)
    if not AntennaSettings.fewest_rows <= len(rows) <= AntennaSettings.most_rows:
        remedy = f"at least {AntennaSettings.fewest_rows}, spread between clamp and load, are needed"
        if len(rows) > AntennaSettings.most_rows:
            remedy = f"average them to {AntennaSettings.most_rows} at most"
        raise InputError(f"has {len(rows)} readings", where=path, remedy=remedy)
    x, unloaded, loaded = (np.array([number(row, name, path) for row in rows]) for name in _COLUMNS)
    places = [f"{path} line {row['line']}" for row in rows]
    _check_positions(x, distance_m, places)
    _check_deflections(loaded - unloaded, x, force_N, distance_m, places, path)
    # the power of ten of the last digit that is written down: -3 for 0.120 and for 5e-3
    silent = Context(traps=[])  # of an exponent beyond decimals nothing is known
    digits = [Decimal(row[name], silent).as_tuple().exponent for row in rows for name in _COLUMNS[1:]]
    finest = min(exponent if isinstance(exponent, int) else -MAX_EMAX for exponent in digits)
    return DeflectionTable(x, unloaded, loaded, 10.0**finest)


def check_load(force_N: float, distance_m: float) -> None:
    """Raises InputError when force or distance cannot be those of a bench test."""
    if not np.isfinite(force_N) or force_N == 0.0:
        raise InputError(f"the force is {force_N:g}", remedy="give the load in newtons (mass in kg times 9.81)")
    if not 0.0 < distance_m <= AntennaSettings.longest_rod_m:
        raise InputError(f"the distance is {distance_m:g}", remedy="give metres from the clamp to the load")


def _check_positions(x_m: np.ndarray, distance_m: float, places: list[str]) -> None:
    for before, x, place in zip([-np.inf, *x_m], x_m, places, strict=False):
        rules = (
            (x < 0.0, f"x_m is {x:g}", "measure x from the clamp towards the load, in metres"),
            (
                x > distance_m,
                f"x_m is {x:g}, beyond the load at {distance_m:g} m",
                "give x and the distance in metres from the clamp, and take out readings beyond the load",
            ),
            (x == before, f"x_m is {x:g} a second time", "put the mean of repeated readings in one row"),
            (x < before, f"x_m falls from {before:g} to {x:g}", "sort the rows by x, and check this one"),
        )
        for wrong, what, remedy in rules:
            if wrong:
                raise InputError(what, where=place, remedy=remedy)


def _check_deflections(
    deflection_m: np.ndarray, x_m: np.ndarray, force_N: float, distance_m: float, places: list[str], path: Path
) -> None:
    worst = int(np.argmax(np.abs(deflection_m)))
    if abs(deflection_m[worst]) > distance_m:
        raise InputError(
            f"the rod is deflected by {deflection_m[worst]:g} m, more than its length {distance_m:g} m",
            where=places[worst],
            remedy="give the readings in metres (1 mm is 0.001)",
        )
    if not deflection_m.any():
        raise InputError(
            "loaded_y_m equals unloaded_y_m in every row", where=path, remedy="give the readings without and with load"
        )
    # by the half nearer to the load, where the bending exceeds the gauge's offset
    far = deflection_m[x_m >= np.median(x_m)]
    rise = np.polyfit(x_m, deflection_m, 1)[0]
    if np.median(far) * force_N < 0.0 and rise * force_N < 0.0:
        raise InputError(
            f"the deflections (loaded less unloaded, {np.median(far):g} m near the load) run against the force",
            where=path,
            remedy="swap the two columns, or give the force the other sign",
        )
