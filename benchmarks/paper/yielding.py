"""What the paper argues and does not measure: objects that give way mislead the Active Antenna, not the VBAA."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.estimator.setup import drawn_truth, rod_of
from benchmarks.harness import column, of_any, or_none, rms_known, spread
from estimator import ContactEstimator
from estimator.paper.baselines import Answer, Ring, press_from_recording, run_method
from estimator.paper.baselines.methods import _compliance_of as compliance_of
from estimator.paper.baselines.methods import _PressSettings as PressSettings
from vbaa_calib.rig import Rig
from vbaa_calib.simulate.contact.touch import touch

from .rig import Pictures, free_point, free_shape, paper_rig, ring_down, taken
from .sensing import ALL_POINTS, knife_edge

STIFFNESSES_N_M = tuple(float(f"{k:.3g}") for k in np.geomspace(10.0, 1e5, 9))
DISTANCE_M, SIGMA_PX = 0.12, 0.1
_PANS_RAD = np.radians(np.linspace(0.5, 6.0, 12))
_BASELINES = ("Active Antenna", "Dynamic Active Antenna", "2D-VBAA, pushing")
TRUE_RIGS = 6
_SLIPPERY_RAD = 0.0
"""Friction that the estimator expects: none."""


@dataclass(frozen=True)
class YieldingRow:
    """One method against one stiffness, over the draws; None where no draw was answered.

    answered : share of the draws that were given a distance. l_error_mm : mean, l_rms_mm : rms; l_expected_mm : what
    the Active Antenna's formula gains by theory, 3EI/(k·l²).
    object_answered, object_mean_N_m, object_rms : of the object's stiffness; the error relative to the true one.
    object_covered : share of the intervals of two deviations, of the compliance, that hold it.
    """

    method: str = column("method")
    stiffness_N_m: float = column("k N/m", ".4g")
    draws: int = column()
    answered: float = column("answered %", ".1f", 100)
    l_error_mm: float | None = column("l error mm", ".2f")
    l_rms_mm: float | None = column("rms", ".2f")
    l_stated_mm: float | None = column("stated", ".2f")
    l_expected_mm: float | None = column("expected", ".2f")
    object_answered: float = column("k answered %", ".1f", 100)
    object_mean_N_m: float | None = column("k mean", ".1f")
    object_rms: float | None = column("rms %", ".1f", 100)
    object_covered: float | None = column("covered %", ".1f", 100)


@dataclass(frozen=True, eq=False)
class Pushed:
    """One true antenna pushed into one object: F frames, the free antenna, the ring-down at the end, the truth."""

    touched: Pictures
    free: Pictures
    ring: Ring
    distance_m: float


def pushed(true: Rig, stiffness_N_m: float) -> Pushed:
    """The base turns about z against an edge that stands along z: the antenna is bent within plane C."""
    gravity, radius = true.gravity_world_m_s2, 0.5 * true.antenna.diameter_m
    free = free_shape(true, gravity[None])
    obj = knife_edge(0.0, free_point(true, DISTANCE_M), radius, stiffness_N_m=stiffness_N_m)
    poses = [true.kinematics.T_world_antenna(float(pan), 0.0) for pan in _PANS_RAD]
    found = touch(rod_of(true), radius, obj, poses, gravity)
    distance = float(found.contact_m[-1])
    ring = Ring(*ring_down(true.antenna, distance, stiffness_N_m))
    return Pushed(taken(true, found.shape), taken(true, free), ring, distance)


def run(draws: int, seed: int) -> list[YieldingRow]:
    """All stiffnesses and methods."""
    rig, rng = paper_rig(), np.random.default_rng(seed)
    trues = [drawn_truth(rig, rng) for _ in range(min(TRUE_RIGS, draws))]
    rows = []
    for stiffness in STIFFNESSES_N_M:
        pushes = [pushed(true, stiffness) for true in trues]
        used = [pushes[draw % len(pushes)] for draw in range(draws)]
        readings: dict[str, list[Answer]] = {name: [] for name in _BASELINES}
        whole = []
        for each in used:
            drawn, free = each.touched.noisy(rig, SIGMA_PX, rng), each.free.noisy(rig, SIGMA_PX, rng)
            noise = rng.normal(0.0, rig.moment_sensor.std_Nm, each.ring.moment_Nm.shape)
            ring = Ring(each.ring.time_s, each.ring.moment_Nm + noise)
            seen = (drawn.points_px, drawn.moment_Nm), (free.points_px, free.moment_Nm), (_PANS_RAD, 0.0 * _PANS_RAD)
            press = press_from_recording(rig, *seen, sigma_px=SIGMA_PX, ring=ring)
            for name in _BASELINES:
                readings[name].append(run_method(name, press))
            whole.append(drawn)
        readings[ALL_POINTS] = [_by_all_points(rig, drawn) for drawn in whole]
        gained = 3e3 * rig.antenna.stiffness_Nm2 / (stiffness * DISTANCE_M**2)
        for name, several in readings.items():
            row = _row(name, stiffness, np.array([each.distance_m for each in used]), several)
            rows.append(replace(row, l_expected_mm=gained) if name == "Active Antenna" else row)
    return rows


def _by_all_points(rig: Rig, drawn: Pictures) -> Answer:
    """The estimator's last contact, and 1/k from all of its contacts: their way in the world's y over the force there.

    The covariances hold the calibration as if it were each frame's own error, so that k's deviation is a cautious one.
    """
    found = ContactEstimator(rig, friction=_SLIPPERY_RAD).estimate_batch(
        drawn.points_px, drawn.moment_Nm[:, 1], _PANS_RAD, np.zeros(len(_PANS_RAD)), sigma_px=SIGMA_PX
    )
    last = Answer(float(found.distance_m[-1]), float(found.distance_std_m[-1]))
    known = np.isfinite(found.distance_m)
    across = rig.kinematics.world_antenna(_PANS_RAD, np.zeros(len(_PANS_RAD)))[0][known, 1]
    picked = np.zeros((int(known.sum()), 2, 6))
    picked[:, 0, 3:], picked[:, 1, :3] = -across, across
    covariance = np.einsum("nai,nij,nbj->nab", picked, found.numbers.covariance[known], picked)
    values = np.stack([-found.force_world_N[known, 1], found.point_world_m[known, 1]], axis=1)
    compliance, std = compliance_of(values, covariance)
    if not compliance > PressSettings.compliance_std * std:
        return last
    return replace(last, object_stiffness_N_m=1.0 / compliance, object_stiffness_std_N_m=std / compliance**2)


def _row(method: str, stiffness_N_m: float, true_m: np.ndarray, readings: list[Answer]) -> YieldingRow:
    off = 1e3 * (np.array([each.distance_m for each in readings]) - true_m)
    object_N_m = np.array([each.object_stiffness_N_m for each in readings])
    object_std = np.array([each.object_stiffness_std_N_m for each in readings])
    said, determined = np.isfinite(off), np.isfinite(object_N_m)
    with np.errstate(invalid="ignore"):
        inside = np.abs(1.0 / object_N_m - 1.0 / stiffness_N_m) <= 2.0 * object_std / object_N_m**2
    mean, _, rms = spread(off[said], off[said])
    stated = or_none(rms_known(1e3 * np.array([each.distance_std_m for each in readings])[said]))
    found = object_N_m[determined]
    return YieldingRow(
        method,
        stiffness_N_m,
        len(readings),
        float(said.mean()),
        *(mean, rms, stated, None),
        float(determined.mean()),
        *(of_any(np.mean, found), or_none(rms_known(found / stiffness_N_m - 1.0))),
        of_any(np.mean, inside[determined]),
    )
