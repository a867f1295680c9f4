"""One camera and two at right angles, on the same touches in every direction across the antenna."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.coverage.coverage import (
    MOMENT_NM,
    NOMINAL,
    T_ANTENNA_JIG,
    CoverageRig,
    draw,
    drawn_truth,
    observations,
    prior_of,
    with_views,
)
from benchmarks.harness import column, concatenated, mean, processor_seconds, rms, table
from estimator import ContactEstimator
from estimator.contact.contacts import Contacts
from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment, adjust_bundle
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import RIG_PARAMETERS, Rig
from vbaa_calib.session import LoadReadings
from vbaa_calib.simulate.scene.lens import Lens

from .bound import Bound, bound
from .scenes import Scenes, random_scenes, seen
from .setup import Setup

SIGMAS_PX = (0.05, 0.5)
_FRICTION_RAD = 0.2
_COVERED, _SILENT = 1.96, 5.0
_RIGS, _FEWER = 100, 20
"""True rigs, and by how much fewer contacts there are of each than of a rig that is known exactly: their errors go
together, so that the intervals' share scatters with the number of rigs."""
_BOUND_DRAWS = 50
"""Errors of each frame that are drawn from its bound."""
_READINGS = LoadReadings(5e-4, 5e-3)


@dataclass(frozen=True)
class ContactsRow:
    """Place and force of contacts by one method, beside the Cramér–Rao bound.

    answered : share of the frames with a place or a force. place_median_mm, place_rms_mm : of the distances' errors.
    bound_median_mm, bound_rms_mm : of errors drawn from the bound of the frames with a place, rig and friction with
        their priors. force, force_bound : median of the lateral force's error over the force, and of errors likewise
        drawn. covered, force_covered : shares of the errors of the distance, and of f_y and f_z, within 1.96 of their
        standard deviations. silent : places off by more than 5 of these. ms : processor time a frame. ratio : of it
        to the first method's on the same contacts.
    """

    kind: str = column("contacts")
    noise_px: float = column("px", ".2f")
    method: str = column("method")
    answered: float = column("answered %", ".1f", 100)
    place_median_mm: float = column("median mm", ".3f")
    bound_median_mm: float = column("bound", ".3f")
    place_rms_mm: float = column("rms mm", ".3f")
    bound_rms_mm: float = column("bound", ".3f")
    force: float = column("force %", ".2f", 100)
    force_bound: float = column("bound", ".2f", 100)
    covered: float = column("covered %", ".1f", 100)
    force_covered: float = column("force covered %", ".1f", 100)
    silent: int = column("silent", "d")
    ms: float = column("ms", ".3f")
    ratio: float = column("ratio", ".2f")


Answer = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Contact distances (B,) and forces (B, 2) along y and z, each with its standard deviations; NaN where unknown."""


def answer(found: Contacts) -> Answer:
    """Of an estimator."""
    return found.distance_m, found.distance_std_m, found.force_N[:, 1:], found.force_std_N[:, 1:]


def judged(
    names: tuple[str, float, str],
    parts: Sequence[Scenes],
    answers: Sequence[Answer],
    least: Bound,
    ms: float,
    first_ms: float,
) -> ContactsRow:
    """One method's row. names : contacts, noise and method. least : the bound of all frames."""
    distance, std, force, force_std = (np.concatenate(each) for each in zip(*answers, strict=True))
    true = np.concatenate([part.force_N[:, 1:] for part in parts])
    off, missed = distance - np.concatenate([part.distance_m for part in parts]), force - true
    size = np.linalg.norm(true, axis=1)
    placed, forced, stated = np.isfinite(off), np.isfinite(missed), np.isfinite(std) & np.isfinite(off)
    score = np.abs(off[stated]) / std[stated]
    known = np.isfinite(force_std) & forced
    drawn = least.drawn(placed | forced.all(axis=1), _BOUND_DRAWS)
    lateral = np.linalg.norm(drawn[..., 1:], axis=-1) / size[placed | forced.all(axis=1)]
    return ContactsRow(
        *names,
        answered=float((placed | forced.all(axis=1)).mean()),
        place_median_mm=1e3 * float(np.median(np.abs(off[placed]))) if placed.any() else np.nan,
        bound_median_mm=1e3 * float(np.nanmedian(np.abs(drawn[..., 0]))),
        place_rms_mm=1e3 * rms(off[placed]),
        bound_rms_mm=1e3 * float(np.sqrt(np.nanmean(drawn[..., 0] ** 2))),
        force=float(np.nanmedian(np.linalg.norm(missed, axis=1) / size)),
        force_bound=float(np.nanmedian(lateral)),
        covered=mean(score < _COVERED),
        force_covered=mean(np.abs(missed[known] / force_std[known]) < _COVERED),
        silent=int((score > _SILENT).sum()),
        ms=ms,
        ratio=ms / first_ms,
    )


def with_second(rig: Rig, angle_rad: float = np.pi / 2) -> Rig:
    """The rig with a second camera like the first, `right`, turned by an angle about the antenna's x axis; the first is
    `left`."""
    count = len(RIG_PARAMETERS) + len(rig.camera.parameter_names)
    covariance = np.zeros((count, count))
    covariance[: len(rig.covariance), : len(rig.covariance)] = rig.covariance
    first, turn = (
        replace(rig, covariance=covariance, camera_name="left"),
        Pose.from_rotvec(np.array([angle_rad, 0.0, 0.0]), np.zeros(3)),
    )
    second = replace(first, T_antenna_camera=turn @ rig.T_antenna_camera, camera_name="right")
    return replace(first, others={"right": second})


def centrelines(rig: Rig, frames: Scenes, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Pixels (B, N, 2) of each of a rig's cameras, with the frames' noise."""
    pictures = (seen(one.camera, one.T_antenna_camera, frames.shapes.points_m) for one in rig.cameras.values())
    noisy = [points + rng.normal(0.0, frames.sigma_px, points.shape) for points in pictures]
    return dict(zip(rig.cameras, noisy, strict=True))


def drawn(rig: Rig, rng: np.random.Generator) -> Rig:
    """A true rig, all of its cameras, that the given one may be the calibration of."""
    step = rig.axes @ rng.normal(size=rig.axes.shape[1])
    step[RIG_PARAMETERS.index("clamp_give_m")] = 0.0
    return rig.moved(step)


def calibrated(rig: Rig, seed: int) -> Rig:
    """The rig, known as well as a calibration of all of its cameras together knows it: board by hand and in a jig
    before each, free antenna and loads, their places and weights known as a session has them by default."""
    truth, read, alone = drawn_truth(np.random.default_rng((seed, 0))), list[float](), {}
    truth[8] = 0.0  # the simulated clamps are rigid
    for number, (name, one) in enumerate(rig.cameras.items(), 1):
        camera, turn = one.camera, one.T_antenna_camera @ rig.T_antenna_camera.inverse()
        lens = Lens("opencv", camera.image_size, camera.matrix, np.array(camera.distortion))
        there = CoverageRig(name, "opencv4", lens, (), one.T_antenna_camera, T_antenna_jig=turn @ T_ANTENNA_JIG)
        given = draw(with_views(there, 25, (0.14, 0.24)), (seed, number), truth)
        read = read or [seen.still.moment_Nm for seen in given.stills]
        lines = [
            replace(line, still=replace(line.still, moment_Nm=moment), tip_std_px=np.nan)
            for line, moment in zip(observations(given), read, strict=True)
        ]
        before = replace(prior_of(given), readings=_READINGS)
        alone[name] = adjust_bundle(lines, before, NOMINAL.length_m, MOMENT_NM)
    solved = BundleAdjustment.together(alone)
    rigs = {name: one.with_covariance(solved[name].covariance) for name, one in rig.cameras.items()}
    first = rigs.pop(rig.camera_name)
    return replace(first, others=rigs)


def run(count: int, seed: int) -> list[ContactsRow]:
    """Rows of a rig that is known exactly, and of rigs as a calibration knows them."""
    rows = []
    exact_rig = with_second(Setup(exact=True).rig())
    for name, rig in (("exact", exact_rig), ("calibrated", calibrated(exact_rig, seed))):
        for sigma_px in SIGMAS_PX:
            rng = np.random.default_rng((seed, int(1e3 * sigma_px), name == "exact"))
            truths = [rig] if name == "exact" else [drawn(rig, rng) for _ in range(_RIGS)]
            own = count if name == "exact" else max(count // _FEWER, 2)
            parts = [_recorded(true, own, sigma_px, rng) for true in truths]
            rows += _rows(name, rig, parts)
    return rows


def _recorded(true: Rig, count: int, sigma_px: float, rng: np.random.Generator) -> tuple[Scenes, dict[str, np.ndarray]]:
    frames = replace(random_scenes(true, count, rng, friction_std_rad=_FRICTION_RAD), sigma_px=sigma_px)
    read = frames.moment_Nm + rng.normal(0.0, true.moment_sensor.std_Nm, count)
    return replace(frames, moment_Nm=read), centrelines(true, frames, rng)


def _rows(name: str, rig: Rig, parts: Sequence[tuple[Scenes, dict[str, np.ndarray]]]) -> list[ContactsRow]:
    rows: list[ContactsRow] = []
    for cameras in (["left"], ["right"], ["left", "right"]):
        estimator = ContactEstimator(
            rig if len(cameras) > 1 else rig.cameras[cameras[0]], friction=_FRICTION_RAD, jobs=1
        )
        found, seconds, least = [], 0.0, []
        for frames, lines in parts:
            given = {one: lines[one] for one in cameras}
            found.append(answer(estimated(estimator, frames, given)))
            seconds += processor_seconds(lambda: estimated(estimator, frames, given), 3)  # noqa: B023
            true = frames.rig if len(cameras) > 1 else frames.rig.cameras[cameras[0]]
            least.append(bound(replace(frames, rig=true, points_px=lines[cameras[0]]), _FRICTION_RAD))
        every = [frames for frames, _ in parts]
        ms = 1e3 * seconds / sum(map(len, every))
        names = (name, every[0].sigma_px, " and ".join(cameras))
        rows.append(judged(names, every, found, concatenated(least), ms, rows[0].ms if rows else ms))
    return rows


def estimated(estimator: ContactEstimator, frames: Scenes, lines: Mapping[str, np.ndarray]) -> Contacts:
    """The frames by the cameras whose lines are given."""
    several = lines if estimator.rig.others else next(iter(lines.values()))
    read = (frames.moment_Nm, frames.pan_rad, frames.tilt_rad)
    return estimator.estimate_batch(several, *read, sigma_px=frames.sigma_px)


def cameras_text(rows: Sequence[ContactsRow]) -> str:
    """The table."""
    return table(rows, "one camera and two at right angles: every direction of touch, friction of ± 0.2 rad", once=2)
