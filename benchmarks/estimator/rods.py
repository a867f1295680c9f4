"""The estimator on scenes of the static rod: weight, bow, clamp error, steep slopes.

The bias of a frame is its error from a picture without noise, in the deviations that the estimator states for the
noise it is given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.harness import Draws, column, concatenated, rms, shares, table
from vbaa_calib.core.console import progress

from .bound import bound, estimate, quality, truth
from .scenes import deflection_of_push, random_scenes
from .setup import ACROSS, TOWARDS_CLAMP, Setup, drawn_truth

_SMALL_BIAS, _SMALL_BIAS_SHARE = 1 / 3, 0.99
"""A bias up to so much of the deviation is small; goal: so in this share of the `ok` frames."""
_LOCATION_GOAL, _FORCE_GOAL = 0.01, 0.02
"""Of the distance and of the force, rms, where the contact is moved by 5 mm at least, lies within 0.75 L, and where the
bound allows it."""
_LEAST_DEFLECTION_M, _FURTHEST = 5e-3, 0.75
_DRAWN_RIGS = 20
_SWING_M = 0.1


@dataclass(frozen=True)
class _Population:
    """Random scenes of one rig. friction_std_rad : of the angle, with which it is drawn and the estimator given."""

    name: str
    setup: Setup
    friction_std_rad: float = 0.0


def _population(
    name: str, lens: str, tilt_rad: float, azimuth_rad: float, friction: float = 0.0, **more: Any
) -> _Population:
    return _Population(name, Setup(lens, tilt_rad, azimuth_rad, swing_m=_SWING_M, real=True, **more), friction)


POPULATIONS = (
    _population("upright, Brown", "brown", 0.0, TOWARDS_CLAMP),
    _population("40° towards the clamp, no distortion", "none", 0.7, TOWARDS_CLAMP),
    _population("40° across, fisheye", "fisheye", 0.7, ACROSS),
    _population("60° across, 512x512", "brown", 1.05, ACROSS, image_size=(512, 512)),
    _population("40° across, friction", "brown", 0.7, ACROSS, 0.2),
    _population("40° across, rig off", "brown", 0.7, ACROSS, exact=False),
    _population("40° across, rig off, friction", "brown", 0.7, ACROSS, 0.2, exact=False),
)
FIRST_LOOK = (POPULATIONS[2], POPULATIONS[5])


@dataclass(frozen=True)
class RodRow:
    """One population.

    statuses, models : shares of the noisy frames, and of those with numbers, in words.
    small_bias : share of the `ok` frames whose bias is small in l, f_y and f_z; bias_99 : the 99th percentile of the
        largest of the three, in deviations. None where friction or the rig moves every frame by design.
    l_of_bound, l_covered : of the noisy frames' distances, pooled.
    impossible : share of the frames in the goals' range whose bound of l is above the goal for the location (the camera
        sees 𝒟 edge-on, mostly). judged : the other ones in that range that are `ok`.
    location, location_bound : rms relative error of l of those, and its bound.
    force, force_bound : the same of the force as a vector; what friction adds along the antenna is hardly seen.
    """

    population: str = column("population")
    frames: int = column("frames", "d")
    statuses: str = column()
    models: str = column()
    small_bias: float | None = column("small bias %", ".1f", 100)
    bias_99: float | None = column("99th", ".2f")
    l_of_bound: float = column("l of bound", ".3f")
    l_covered: float = column("covered %", ".1f", 100)
    impossible: float = column("impossible %", ".1f", 100)
    judged: int = column("judged", "d")
    location: float = column("location %", ".2f", 100)
    location_bound: float = column("bound %", ".2f", 100)
    force: float = column("force %", ".2f", 100)
    force_bound: float = column("bound %", ".2f", 100)


def run(frames: int, seed: int, model: str = "auto", chosen: Sequence[_Population] = POPULATIONS) -> list[RodRow]:
    """Every population with so many random frames."""
    each = enumerate(progress(chosen, "populations", len(chosen)))
    return [_row(one, frames, model, np.random.default_rng((seed, number))) for number, one in each]


def _row(population: _Population, frames: int, model: str, rng: np.random.Generator) -> RodRow:
    friction, exact, rig = population.friction_std_rad, population.setup.exact, population.setup.rig()
    # scenes without noise; of a rig that is off, from several true ones
    truths = [rig] if exact else [drawn_truth(rig, rng) for _ in range(_DRAWN_RIGS)]
    count = -(-frames // len(truths))
    clean = [random_scenes(each, count, rng, friction_std_rad=friction, given=rig) for each in truths]
    measured = concatenated([estimate(part.noisy(rng), model, friction) for part in clean])
    true = np.concatenate([truth(part) for part in clean])
    least = Draws([bound(part, friction) for part in clean])
    bounds, force_bounds = least.std, least.force_std
    good = measured.numbered
    errors = measured.values - true
    distance = quality(errors[good, 0], measured.std[good, 0], bounds[good, 0])
    force = np.concatenate([part.force_N for part in clean])
    size = np.linalg.norm(force, axis=1)
    # whether the goals for location and force are about a frame
    in_range = deflection_of_push(size, true[:, 0], rig.antenna.stiffness_Nm2) >= _LEAST_DEFLECTION_M
    in_range &= true[:, 0] <= _FURTHEST * rig.antenna.length_m
    possible = bounds[:, 0] <= _LOCATION_GOAL * true[:, 0]
    judged = in_range & possible & (measured.status == "ok")
    missed = np.linalg.norm(measured.force_N - force, axis=1)
    biases = None
    if exact and not friction:
        found = concatenated([estimate(part, model, friction) for part in clean])
        ok = found.status == "ok"
        biases = (np.abs(found.values[ok] - true[ok]) / found.std[ok]).max(axis=1)
    return RodRow(
        population=population.name,
        frames=len(true),
        statuses=shares(measured.status),
        models=shares(measured.model[good]),
        small_bias=None if biases is None else float((biases <= _SMALL_BIAS).mean()),
        bias_99=None if biases is None else float(np.quantile(biases, _SMALL_BIAS_SHARE)),
        l_of_bound=distance.of_bound,
        l_covered=distance.covered,
        impossible=float(1.0 - possible[in_range].mean()) if in_range.any() else np.nan,
        judged=int(judged.sum()),
        location=rms(errors[judged, 0] / true[judged, 0]),
        location_bound=rms(bounds[judged, 0] / true[judged, 0]),
        force=rms(missed[judged] / size[judged]),
        force_bound=rms(force_bounds[judged] / size[judged]),
    )


def rod_text(rows: Sequence[RodRow]) -> str:
    """The table, then each population's statuses and rungs."""
    title = (
        "scenes of the static rod, slopes up to 35°, weight, bow, clamp error; small bias: ok frames biased by at most "
        f"a third of their deviation (goal\n{100 * _SMALL_BIAS_SHARE:.0f} %); location and force: rms relative errors "
        "at 5 mm and more, within 0.75 L, where the bound allows the goals of "
        f"{100 * _LOCATION_GOAL:.0f} and {100 * _FORCE_GOAL:.0f} %"
    )
    return "\n".join([table(rows, title), *(f"{row.population}: {row.statuses}; {row.models}" for row in rows)])
