"""Typed loads: impossible rows of loads.csv, rows that their pictures contradict, and the entries that would fit.

Rig parameters come from the free antenna: a wrong row must not affect what other rows are judged by. Only EI is
estimated from the loads, from those that agree on it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from vbaa_calib.antenna.shape import Curves
from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.inputs import Observation
from vbaa_calib.calibrate.antenna.problem import ANTENNA, LensLost
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.core.robust import chi_square_p
from vbaa_calib.rig.reprojection import image_curves, see, whitened_residuals
from vbaa_calib.session import STANDARD_GRAVITY_M_S2 as _G
from vbaa_calib.session import Load, NominalAntenna

from .explanations import picture_scatter, reading_std

_UNITS = (
    ("in grams", 1e-3 * _G),
    ("in kilograms", _G),
    ("in millinewtons", 1e-3),
    ("in pounds", 4.4482),
    ("in ounces", 0.27801),
    ("multiplied by 9.81 twice", 1 / _G),
    ("a decimal place too small", 10.0),
    ("a decimal place too large", 0.1),
)
"""What a force may have been given in, and the factor that makes newtons of it; the commonest first."""
_LENGTHS = (
    ("in centimetres", 1e-2),
    ("in millimetres", 1e-3),
    ("in inches", 0.0254),
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
_TOO_STEEP_RAD = 1.2  # slope at the load, by the nominal antenna's linear beam, that nobody hangs on purpose
_TOO_FLAT_RAD = 1e-3  # slope that no picture shows well: a tenth of a millimetre at 150 mm
_LIKELY_RAD = 0.2
_NOMINAL_REACH, _KNOWN_REACH, _FAR_REACH = 0.3, 0.03, 1.0
"""Largest |log| of EI over the free antenna's or E·πd⁴/64 (8 % of the diameter); over what other loads agree on; and in
looking for loads that agree: no wrong unit is as little as this."""
_STEP = 0.05
_CONTRADICTS, _FITS = 0.22, 0.08
"""An entry is wrong whose antenna lies further off the points than this part of the deflection, and right below the
other. Half a millimetre on the ruler and half a per cent on the balance make 0.02."""
_CLEARER = 3.0  # a right entry lies this many times nearer than the noted one
_ALIKE = 0.01  # entries whose misfits differ by less are indistinguishable
_SAME_VALUE = 0.03  # entries that differ by less are the same number: a kilogram is 9.81 N, a lost digit 10
_SHOWN_STD = 5.0  # least deflection, in deviations of single points, that distinguishes entries
_CHANCE, _CURVE = 1e-5, 3  # of a false alarm in a session; degree of the curve that contradicts a row
_AGREE = 0.1  # logarithm within which loads agree on EI
_MOST_BENT = 6.0  # f·l²/EI beyond which an antenna hangs along its load: more looks the same


class _Entry(NamedTuple):
    """What a row may have meant: "force" or "distance", the slip, to be read after "given", and the load meant."""

    what: str
    how: str
    load: Load

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
        names = ["distance_m"] if self.what == "distance" else ["force_y_N", "force_z_N"]
        pairs = [(name, getattr(noted, name), getattr(self.load, name)) for name in names]
        size = max(abs(value) for _, *values in pairs for value in values)
        return ", ".join(f"{name} {a:.4g} → {b:.4g}" for name, a, b in pairs if abs(a - b) > _SAME * size)


def _other_entries(load: Load, length_m: float) -> list[_Entry]:
    """Everything else that a row could have meant, one slip at a time, the commonest first."""
    y, z, at = load.force_y_N, load.force_z_N, load.distance_m
    places = [(how, factor * at) for how, factor in _LENGTHS if 0 < factor * at <= length_m]
    if length_m - at > _SAME and abs(length_m - 2 * at) > 0.02 * length_m:
        places.append(("from the tip", length_m - at))
    turned, known = [], [(y, z)]
    for how, (yy, yz, zy, zz) in _TURNS:
        other = yy * y + yz * z, zy * y + zz * z
        if all(abs(other[0] - a) + abs(other[1] - b) > _SAME * (abs(y) + abs(z)) for a, b in known):
            known.append(other)
            turned.append((how, other))

    def forces(slips: Sequence[tuple[str, tuple[float, float]]]) -> list[_Entry]:
        return [_Entry("force", how, replace(load, force_y_N=y, force_z_N=z)) for how, (y, z) in slips]

    distances = [_Entry("distance", how, replace(load, distance_m=x)) for how, x in places]
    return forces([(how, (factor * y, factor * z)) for how, factor in _UNITS]) + distances + forces(turned)


def _row_name(index: int, load: Load) -> str:
    """Name of a row of loads.csv, its first load being row 1."""
    return f"row {index + 1}" + (f" ({load.image.name})" if load.image else "")


def _rows_name(rows: Sequence[tuple[int, Load]], count: int = 0) -> str:
    """Name of several rows of loads.csv, which has `count` loads; 0: unknown."""
    if len(rows) == count > 1:
        return f"all {count} rows of loads.csv"
    more = f" and {len(rows) - 4} more" if len(rows) > 4 else ""
    return "loads.csv " + ", ".join(_row_name(index, load) for index, load in rows[:4]) + more


def typed_load_diagnoses(loads: Sequence[Load], antenna: NominalAntenna) -> list[Diagnosis]:
    """Typed loads that are impossible by the nominal antenna alone."""
    rows, length_m, found = list(enumerate(loads)), antenna.length_m, []
    inside = [(index, load) for index, load in rows if 0 < load.distance_m <= length_m]
    beyond = [row for row in rows if row not in inside]
    if beyond:
        at = beyond[0][1].distance_m
        units = [how for how, factor in _LENGTHS[:2] if 0.02 * length_m < factor * at <= length_m]
        guess = f"was it given {' or '.join(units)}? " if units else ""
        words = f"{_rows_name(beyond, len(rows))}: distance_m is {at:.4g}, the antenna is {length_m:g} m long"
        remedy = f"{guess}Give metres from the clamp along the antenna"
        found.append(Diagnosis("load_distance_unit", words, remedy, "wrong"))

    def slope_rad(row: tuple[int, Load]) -> float:
        """At the load, by the linear beam: f·l²/2EI."""
        return _force_N(row[1]) * row[1].distance_m ** 2 / (2.0 * antenna.stiffness_Nm2)

    def described(row: tuple[int, Load], which: Sequence[tuple[int, Load]], digits: str) -> tuple[str, float]:
        """The rows' name with one of them, and how far its tip would move, mm."""
        load, tip_mm = row[1], 1e3 * slope_rad(row) * (length_m - row[1].distance_m / 3)
        name = _rows_name(which, len(rows))
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
        found.append(Diagnosis("load_force_unit", words, remedy, "wrong"))
    flat = [row for row in inside if slope_rad(row) < _TOO_FLAT_RAD]
    if flat:
        words, tip_mm = described(min(flat, key=slope_rad), flat, ".3g")
        remedy = "give newtons, not kilonewtons or kilograms, and metres; or hang more weight farther out"
        found.append(Diagnosis("load_too_small", f"{words} move the tip by {tip_mm:.2g} mm only", remedy))
    return found


def _force_N(load: Load) -> float:
    return math.hypot(load.force_y_N, load.force_z_N)


@dataclass(frozen=True, eq=False)
class Row:
    """A load whose picture contradicts its row."""

    index: int  # among the loads
    load: Load
    entry: _Entry | None  # what fits instead; None if nothing does
    also: tuple[str, ...] = ()  # other slips that fit as well


class _Fit(NamedTuple):
    """The best fits of V loads to one picture, over a range of stiffness."""

    misfit: np.ndarray  # (V,) mean distance of the points from the predicted antenna, over that from the free one
    log_stiffness: np.ndarray  # (V,) of the best fit, less the free antenna's
    shown_std: float  # mean distance of the points from the free antenna, in their own deviations


def wrong_rows(free: BundleAdjustment, observations: Sequence[Observation], length_m: float) -> list[Row]:
    """Every load whose row does not fit its picture, with the entry that does."""
    loaded = [(one, one.still) for one in observations if isinstance(one.still, Load)]
    centre, reach = _reference(free, loaded)
    rows = []
    for index, (one, load) in enumerate(loaded):
        fit = _fit(free, one, [load], centre, reach)
        noted = fit.misfit[0]
        if noted <= _CONTRADICTS:
            continue
        if np.isfinite(noted) and _chance(free, one, load, fit.log_stiffness[0], reach) * len(loaded) > _CHANCE:
            continue
        entries = _other_entries(load, length_m)
        others = _fit(free, one, [entry.load for entry in entries], centre, reach)
        nearest = float(others.misfit.min())
        alike = np.flatnonzero(others.misfit <= nearest + _ALIKE).tolist()
        # the commonest slip of those that the picture cannot distinguish from the best one
        first = entries[int(np.argmin(others.misfit))]
        same_kind = [entries[i] for i in alike if entries[i].is_turn == first.is_turn]
        best = next(entry for entry in same_kind if first.is_turn or not _differ(entry.load, first.load))
        right = others.shown_std >= _SHOWN_STD and nearest <= _FITS and nearest * _CLEARER <= noted
        also = tuple(entries[i].how for i in alike if entries[i] is not best and _differ(entries[i].load, best.load))
        rows.append(Row(index, load, best if right else None, also))
    return rows


def _differ(a: Load, b: Load) -> bool:
    """Whether two loads are different numbers."""
    apart = np.hypot(a.force_y_N - b.force_y_N, a.force_z_N - b.force_z_N)
    size = np.hypot(b.force_y_N, b.force_z_N)
    return bool(apart > _SAME_VALUE * size or abs(a.distance_m - b.distance_m) > _SAME_VALUE * b.distance_m)


def row_diagnoses(rows: Sequence[Row], count: int) -> list[Diagnosis]:
    """The rows, of `count` loads, that another entry explains, those with the same slip together."""
    by_slip: dict[tuple[str, str], list[tuple[Row, _Entry]]] = {}
    for row in rows:
        if row.entry is not None:
            by_slip.setdefault((row.entry.what, row.entry.how), []).append((row, row.entry))
    found = []
    for same in by_slip.values():
        first, entry = same[0]
        also = sorted({how for row, _ in same for how in row.also})
        words = (
            f"{_rows_name([(row.index, row.load) for row, _ in same], count)}: the picture contradicts the row, and "
            f"would fit if the {entry.what} was given {entry.how}"
        )
        if also:
            words += f" (or {' or '.join(also[:2])}: the picture cannot decide)"
        words += f". Is it {entry.question(first.load)}?"
        cells = "; ".join(f"{_row_name(row.index, row.load)}: {own.remedy(row.load)}" for row, own in same[:3])
        found.append(Diagnosis(f"load_{entry.what}_mistyped", words, f"if so, correct {cells}", "wrong"))
    return found


def unexplained(rows: Sequence[Row]) -> list[Diagnosis]:
    """The rows that their pictures contradict and no usual slip explains."""
    words = (
        f"{_rows_name([(row.index, row.load) for row in rows])}: the picture contradicts the row by a fifth of the "
        "deflection or more, and no usual slip explains it"
    )
    remedy = "check distance_m, force and sign of the row, that the picture belongs to it, and that the clamp held"
    return [Diagnosis("load_row_unexplained", words, remedy, "wrong")] if rows else []


def corrected(observations: Sequence[Observation], rows: Sequence[Row]) -> list[Observation]:
    """With the entries that fit; without the rows that none fits."""
    by_load = {id(row.load): row.entry for row in rows}
    found = []
    for one in observations:
        entry = by_load.get(id(one.still))
        if entry is not None:
            found.append(replace(one, still=replace(entry.load, moment_Nm=one.still.moment_Nm)))
        elif id(one.still) not in by_load:
            found.append(one)
    return found


def all_by_commonest(named: Sequence[Row], observations: Sequence[Observation], length_m: float) -> list[Row]:
    """Every load with the slip that most rows have: some pictures look alike either way. Empty where few have it."""
    loads = [one.still for one in observations if isinstance(one.still, Load)]
    slips = [row.entry[:2] for row in named if row.entry is not None]
    slip = max(set(slips), key=slips.count, default=None)
    if slip is None or 2 * slips.count(slip) <= len(loads) or len(loads) < 2:
        return []
    return [
        Row(index, load, entry)
        for index, load in enumerate(loads)
        for entry in _other_entries(load, length_m)
        if entry[:2] == slip
    ]


def _fit(free: BundleAdjustment, one: Observation, loads: Sequence[Load], centre: float, reach: float) -> _Fit:
    """Each load's best fit with a logarithm of EI within `reach` of `centre`, both less the free antenna's."""
    steps = centre + np.linspace(-reach, reach, max(3, 2 * round(reach / _STEP) + 1))
    # an antenna that is stiffer bends as if the force were smaller
    scaled = [
        replace(load, force_y_N=load.force_y_N * factor, force_z_N=load.force_z_N * factor)
        for load in loads
        for factor in np.exp(-steps)
    ]
    problem, parameters = free.problem, free.solution.parameters
    seen = see(problem.camera(parameters), one.points_px, one.sigma_px)
    stiffness = float(np.exp(parameters[ANTENNA][6]))
    nothing = replace(loads[0], force_y_N=0.0, force_z_N=0.0)
    # an impossible load would wind the antenna up: it is not worked out
    bent = [np.hypot(load.force_y_N, load.force_z_N) * load.distance_m**2 / stiffness for load in scaled]
    possible = np.array(bent) < _MOST_BENT
    stills = [replace(one, still=load if fits else nothing) for load, fits in zip(scaled, possible, strict=True)]
    stills = [replace(one, still=nothing), *stills]
    curves = replace(problem, observations=stills).curves(parameters[None, ANTENNA])
    view = problem.pose(parameters).inverse()

    def distance(curve: Curves) -> float:
        image = image_curves(curve, view)
        if not np.isfinite(image.nodes).all():
            return np.inf
        return float(np.abs(whitened_residuals(seen, image)[:, 0]).mean())

    distances = np.array([distance(curves.picked(np.array([index]))) for index in range(len(stills))])
    distances[1:][~possible] = np.inf
    misfit = (distances[1:] / max(distances[0], problem.noise_scale)).reshape(len(loads), len(steps))
    return _Fit(misfit.min(axis=1), steps[misfit.argmin(axis=1)], distances[0] / problem.noise_scale)


def _chance(free: BundleAdjustment, one: Observation, load: Load, log_stiffness: float, reach: float) -> float:
    """Of points so far off a load that is right, by a smooth curve: of noise and the uncertainty of rig, readings and
    EI. log_stiffness : the best one within `reach`, less the free antenna's."""
    softer = float(np.exp(-log_stiffness))
    load = replace(load, force_y_N=load.force_y_N * softer, force_z_N=load.force_z_N * softer)
    parameters, prior = free.solution.parameters, free.problem.prior
    try:
        problem = free.problem.over([replace(one, still=load)]).relinearised(parameters)
    except LensLost:
        return 1.0
    ((residuals, slopes),), (by_load,) = problem.by_still(parameters), problem.whitened_by_load(parameters)
    residuals, slopes, by_load = residuals[:-1], slopes[:-1], by_load[:-1]
    # EI counts by what it makes of the load: with the free antenna's own sag it is known as the pictures know it
    slopes[:, ANTENNA.start + 6] += by_load[:, 1]
    distance_std_m, force_std = reading_std(prior.readings)
    by_load *= distance_std_m, np.hypot(force_std, min(reach, _STEP))
    rig = slopes @ free.solution.covariance_root()
    curves = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, len(residuals)), _CURVE)
    nuisance = np.hstack([rig, by_load, problem.line_modes(0)])
    scale = max(picture_scatter([one]) / problem.noise_scale, 1.0)
    nuisance, curves, residuals = nuisance / scale, curves, residuals / scale
    # generalised least squares of the curve: by Woodbury's identity
    inner = np.linalg.inv(np.eye(nuisance.shape[1]) + nuisance.T @ nuisance)
    both = np.column_stack([curves, residuals])
    crossed = nuisance.T @ both
    products = both.T @ both - crossed.T @ inner @ crossed
    score = products[:-1, -1]
    return chi_square_p(float(score @ np.linalg.lstsq(products[:-1, :-1], score)[0]), _CURVE + 1)


def _reference(free: BundleAdjustment, loaded: Sequence[tuple[Observation, Load]]) -> tuple[float, float]:
    """Logarithm of EI, less the free antenna's, and its reach: from the loads that agree, if two do."""
    start = float(free.problem.prior.mean[6] - free.parameters[ANTENNA][6])
    # a sag that needs quite another antenna has another cause: gravity, or the mass
    start = start if abs(start) > _NOMINAL_REACH else 0.0
    usable = []
    for one, load in loaded:
        fit = _fit(free, one, [load], start, _FAR_REACH)
        at_end = abs(fit.log_stiffness[0] - start) >= _FAR_REACH - 0.5 * _STEP
        if fit.misfit[0] <= _FITS and fit.shown_std >= _SHOWN_STD and not at_end:
            usable.append((one, load, fit.log_stiffness[0]))
    if len(usable) >= 2:
        middle = float(np.median([log_stiffness for *_, log_stiffness in usable]))
        same = [(one, load) for one, load, log_stiffness in usable if abs(log_stiffness - middle) <= _AGREE]
        if len(same) >= 2 and 2 * len(same) > len(usable):
            closer = [_fit(free, one, [load], middle, _AGREE).log_stiffness[0] for one, load in same]
            return float(np.median(closer)), _KNOWN_REACH
    return start, _NOMINAL_REACH
