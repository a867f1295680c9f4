"""Rows of loads.csv that their pictures contradict, and what they would have to say.

The rig is the free antenna's: what was typed for one load must not have bent what another one is judged by. Only EI is
asked of the loads, of those that agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.calibrate.antenna.bundle_adjustment import JointSolution
from vbaa_calib.calibrate.antenna.inputs import Observation
from vbaa_calib.calibrate.antenna.problem import ANTENNA
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.session import Load

from .free_antenna import faithful
from .typed_loads import Reading, other_readings, row_name

NOMINAL_REACH = 0.3
"""Logarithm by which EI may differ from what the free antenna and E·πd⁴/64 say: 8 % of the diameter."""
KNOWN_REACH = 0.03
"""The same where other loads agree on it."""
FAR_REACH = 1.0
"""The same in looking for loads that agree: no wrong unit is as little as this."""
STEP = 0.05
CONTRADICTS, FITS = 0.22, 0.08
"""A reading is wrong whose antenna lies further off the points than this part of the deflection, and right below the
other. Half a millimetre on the ruler and half a per cent on the balance make 0.02."""
CLEARER = 3.0
"""A right reading lies this many times nearer than the noted one."""
ALIKE = 0.01
"""Misfits that differ by less tell nothing between two readings."""
SAME_VALUE = 0.03
"""Readings that differ by less are the same number, by whatever slip: a kilogram is 9.81 N, a lost digit is 10."""
SHOWN_STD = 5.0
"""Least deflection, in deviations of single points, that tells one reading from another."""
AGREE = 0.1
"""Logarithm within which loads agree on EI."""


@dataclass(frozen=True, eq=False)
class Nearest:
    """The best fits of V readings of a load.

    Attributes
    ----------
    misfit, log_stiffness : (V,) of each, and the stiffness's logarithm that it takes, less the free antenna's.
    shown_std : see `Faithful`.
    """

    misfit: np.ndarray
    log_stiffness: np.ndarray
    shown_std: float


@dataclass(frozen=True, eq=False)
class Row:
    """A load whose picture contradicts its row.

    Attributes
    ----------
    index : of the load among the loads. reading : what fits instead, None if nothing does.
    also : how else it may have been given: what the picture does not tell from that.
    """

    index: int
    load: Load
    reading: Reading | None
    also: tuple[str, ...] = ()


def wrong_rows(free: JointSolution, observations: Sequence[Observation], length_m: float) -> list[Row]:
    """Every load whose row does not fit its picture, with the reading that does."""
    loaded = [one for one in observations if isinstance(one.still, Load)]
    centre, reach = _reference(free, loaded)
    rows = []
    for index, one in enumerate(loaded):
        load = _load(one)
        noted = _nearest(free, one, [load], centre, reach).misfit[0]
        if noted <= CONTRADICTS:
            continue
        readings = other_readings(load, length_m)
        others = _nearest(free, one, [reading.load for reading in readings], centre, reach)
        nearest = float(others.misfit.min())
        best = int(_commonest(readings, others.misfit))
        right = others.shown_std >= SHOWN_STD and nearest <= FITS and nearest * CLEARER <= noted
        alike = np.flatnonzero(others.misfit <= nearest + ALIKE).tolist()
        also = tuple(
            readings[other].how for other in alike if other != best and _apart(readings[other], readings[best])
        )
        rows.append(Row(index, load, readings[best] if right else None, also))
    return rows


def _commonest(readings: Sequence[Reading], misfit: np.ndarray) -> int:
    """The commonest of the readings that the picture does not tell from the best one."""
    best = int(np.argmin(misfit))
    alike = [int(i) for i in np.flatnonzero(misfit <= misfit[best] + ALIKE)]
    same_kind = [i for i in alike if readings[i].is_turn == readings[best].is_turn]
    return next(i for i in same_kind if readings[best].is_turn or not _apart(readings[i], readings[best]))


def _apart(one: Reading, other: Reading) -> bool:
    """Whether two readings say different numbers."""
    a, b = one.load, other.load
    apart = np.hypot(a.force_y_N - b.force_y_N, a.force_z_N - b.force_z_N)
    size = np.hypot(b.force_y_N, b.force_z_N)
    return bool(apart > SAME_VALUE * size or abs(a.distance_m - b.distance_m) > SAME_VALUE * b.distance_m)


def row_diagnoses(rows: Sequence[Row], count: int) -> list[Diagnosis]:
    """The rows that another reading explains, those with the same slip together."""
    by_slip: dict[str, list[Row]] = {}
    for row in rows:
        if row.reading is not None:
            by_slip.setdefault(row.reading.name, []).append(row)
    return [_said(same, count) for same in by_slip.values()]


def unexplained(rows: Sequence[Row]) -> list[Diagnosis]:
    """The rows that their pictures contradict and no usual slip explains."""
    if not rows:
        return []
    names = ", ".join(row_name(row.index, row.load) for row in rows[:4])
    more = f" and {len(rows) - 4} more" if len(rows) > 4 else ""
    return [
        Diagnosis(
            "load_row_unexplained",
            f"loads.csv {names}{more}: the picture contradicts the row by a fifth of the deflection or more, and no "
            "usual slip explains it",
            "check distance_m, force and sign of the row, that the picture belongs to it, and that the clamp held",
            grave=True,
        )
    ]


def corrected(observations: Sequence[Observation], rows: Sequence[Row]) -> list[Observation]:
    """With the readings that fit; without the rows that none fits."""
    by_index, found, index = {row.index: row for row in rows}, [], -1
    for one in observations:
        index += isinstance(one.still, Load)
        row = by_index.get(index) if isinstance(one.still, Load) else None
        if row is None:
            found.append(one)
        elif row.reading is not None:
            found.append(replace(one, still=replace(row.reading.load, moment_Nm=one.still.moment_Nm)))
    return found


def all_by_commonest(named: Sequence[Row], observations: Sequence[Observation], length_m: float) -> list[Row]:
    """Every load with the slip that most rows have: some pictures look alike either way. Empty where few have it."""
    loads = [_load(one) for one in observations if isinstance(one.still, Load)]
    slips = [row.reading.name for row in named if row.reading is not None]
    name = max(set(slips), key=slips.count, default="")
    if 2 * slips.count(name) <= len(loads) or len(loads) < 2:
        return []
    rows = []
    for index, load in enumerate(loads):
        same = [reading for reading in other_readings(load, length_m) if reading.name == name]
        rows += [Row(index, load, reading) for reading in same]
    return rows


def _said(rows: Sequence[Row], count: int) -> Diagnosis:
    first = rows[0]
    assert first.reading is not None
    whole = len(rows) == count and count > 1
    names = [row_name(row.index, row.load) for row in rows[:4]]
    which = f"all {count} rows of loads.csv" if whole else "loads.csv " + ", ".join(names)
    if not whole and len(rows) > 4:
        which += f" and {len(rows) - 4} more"
    words = (
        f"{which}: the picture contradicts the row, and would fit if the {first.reading.what} was given "
        f"{first.reading.how}"
    )
    also = sorted({how for row in rows for how in row.also})
    if also:
        words += f" (or {' or '.join(also[:2])}: the picture does not tell)"
    cells = "; ".join(
        f"{row_name(row.index, row.load)}: {row.reading.remedy(row.load)}" for row in rows[:3] if row.reading
    )
    words += f". Is it {first.reading.question(first.load)}?"
    return Diagnosis(f"load_{first.reading.what}_mistyped", words, f"if so, correct {cells}", grave=True)


def _load(one: Observation) -> Load:
    assert isinstance(one.still, Load)
    return one.still


def _nearest(free: JointSolution, one: Observation, loads: Sequence[Load], centre: float, reach: float) -> Nearest:
    """Each load's best fit with a stiffness within a range about the free antenna's."""
    steps = centre + np.linspace(-reach, reach, max(3, 2 * round(reach / STEP) + 1))
    # an antenna that is stiffer bends as if the force were smaller
    scaled = [
        replace(load, force_y_N=load.force_y_N * factor, force_z_N=load.force_z_N * factor)
        for load in loads
        for factor in np.exp(-steps)
    ]
    found = faithful(free, one, scaled)
    misfit = found.misfit.reshape(len(loads), len(steps))
    return Nearest(misfit.min(axis=1), steps[misfit.argmin(axis=1)], found.shown_std)


def _reference(free: JointSolution, loaded: Sequence[Observation]) -> tuple[float, float]:
    """EI's logarithm, less the free antenna's, and how far it may be off: by the loads that agree, if two do."""
    start = float(free.problem.prior.mean[6] - free.parameters[ANTENNA][6])
    # a sag that asks for quite another antenna has another cause: gravity, or the mass
    start = start if abs(start) > NOMINAL_REACH else 0.0
    found = [_nearest(free, one, [_load(one)], start, FAR_REACH) for one in loaded]
    usable = [(one, fit) for one, fit in zip(loaded, found, strict=True) if _usable(fit, start)]
    if len(usable) >= 2:
        middle = float(np.median([fit.log_stiffness[0] for _, fit in usable]))
        same = [one for one, fit in usable if abs(fit.log_stiffness[0] - middle) <= AGREE]
        if len(same) >= 2 and 2 * len(same) > len(usable):
            closer = [_nearest(free, one, [_load(one)], middle, AGREE).log_stiffness[0] for one in same]
            return float(np.median(closer)), KNOWN_REACH
    return start, NOMINAL_REACH


def _usable(fit: Nearest, start: float) -> bool:
    at_end = abs(fit.log_stiffness[0] - start) >= FAR_REACH - 0.5 * STEP
    return bool(fit.misfit[0] <= FITS and fit.shown_std >= SHOWN_STD and not at_end)
