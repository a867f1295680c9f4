"""One camera and two at right angles, on the same touches in every direction across the antenna."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.harness import column, processor_seconds, rms, shares, table
from estimator import ContactEstimator
from estimator.contact.contacts import Contacts
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import RIG_PARAMETERS, Rig

from .scenes import Scenes, random_scenes, seen
from .setup import Setup

SIGMAS_PX = (0.05, 0.5)
_FRICTION_RAD = 0.2
_COVERED = 1.96
_RIGS = 20


@dataclass(frozen=True)
class CamerasRow:
    """One choice of cameras at one deviation of the points.

    answered : share of the frames with numbers. l_median_mm, l_rms_mm : of the distance's error. force_median : of the
        lateral force's error over the force. l_covered, f_covered : errors of the distance, and of f_y and f_z, within
        1.96 of their deviations. us : one thread's processor time for each frame. ratio : to the first camera alone.
    """

    rig: str = column("rig")
    sigma_px: float = column("σ px", ".2f")
    cameras: str = column("cameras")
    answered: float = column("answered %", ".1f", 100)
    l_median_mm: float = column("l median mm", ".3f")
    l_rms_mm: float = column("rms", ".3f")
    force_median: float = column("force %", ".2f", 100)
    l_covered: float = column("l covered %", ".1f", 100)
    f_covered: float = column("force covered %", ".1f", 100)
    us: float = column("µs", ".0f")
    ratio: float = column("ratio", ".2f")
    statuses: str = column("statuses")


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


def run(count: int, seed: int) -> list[CamerasRow]:
    """Rows of a rig that is known exactly, and of rigs that were calibrated."""
    rows = []
    for name, exact in (("exact", True), ("calibrated", False)):
        rig = with_second(Setup(exact=exact).rig())
        for sigma_px in SIGMAS_PX:
            rng = np.random.default_rng((seed, int(1e3 * sigma_px), exact))
            truths = [rig] if exact else [drawn(rig, rng) for _ in range(_RIGS)]
            parts = [_recorded(true, max(count // len(truths), 2), sigma_px, rng) for true in truths]
            rows += _rows(name, rig, parts)
    return rows


def _recorded(true: Rig, count: int, sigma_px: float, rng: np.random.Generator) -> tuple[Scenes, dict[str, np.ndarray]]:
    frames = replace(random_scenes(true, count, rng, friction_std_rad=_FRICTION_RAD), sigma_px=sigma_px)
    read = frames.moment_Nm + rng.normal(0.0, true.moment_sensor.std_Nm, count)
    return replace(frames, moment_Nm=read), centrelines(true, frames, rng)


def _rows(name: str, rig: Rig, parts: Sequence[tuple[Scenes, dict[str, np.ndarray]]]) -> list[CamerasRow]:
    rows: list[CamerasRow] = []
    for cameras in (["left"], ["right"], ["left", "right"]):
        estimator = ContactEstimator(
            rig if len(cameras) > 1 else rig.cameras[cameras[0]], friction=_FRICTION_RAD, jobs=1
        )
        found, seconds = [], 0.0
        for frames, lines in parts:
            given = {one: lines[one] for one in cameras}
            found.append(estimated(estimator, frames, given))
            seconds += processor_seconds(lambda: estimated(estimator, frames, given), 3)  # noqa: B023
        rows.append(_judged(name, " and ".join(cameras), parts, found, seconds, rows))
    return rows


def estimated(estimator: ContactEstimator, frames: Scenes, lines: Mapping[str, np.ndarray]) -> Contacts:
    """The frames by the cameras whose lines are given."""
    several = lines if estimator.rig.others else next(iter(lines.values()))
    read = (frames.moment_Nm, frames.pan_rad, frames.tilt_rad)
    return estimator.estimate_batch(several, *read, sigma_px=frames.sigma_px)


def _judged(
    name: str,
    cameras: str,
    parts: Sequence[tuple[Scenes, dict[str, np.ndarray]]],
    found: Sequence[Contacts],
    seconds: float,
    before: Sequence[CamerasRow],
) -> CamerasRow:
    off_m = np.concatenate([one.distance_m - frames.distance_m for one, (frames, _) in zip(found, parts, strict=True)])
    std_m = np.concatenate([one.distance_std_m for one in found])
    off_N = np.concatenate([one.force_N - frames.force_N for one, (frames, _) in zip(found, parts, strict=True)])[:, 1:]
    std_N = np.concatenate([one.force_std_N for one in found])[:, 1:]
    size_N = np.concatenate([np.linalg.norm(frames.force_N[:, 1:], axis=1) for frames, _ in parts])
    located, known = np.isfinite(off_m), np.isfinite(off_N)
    us = 1e6 * seconds / len(off_m)
    return CamerasRow(
        *(name, parts[0][0].sigma_px, cameras, float(located.mean())),
        1e3 * float(np.median(np.abs(off_m[located]))),
        1e3 * rms(off_m[located]),
        float(np.nanmedian(np.linalg.norm(off_N, axis=1) / size_N)),
        float(np.mean(np.abs(off_m / std_m)[located] < _COVERED)),
        float(np.mean(np.abs(off_N / std_N)[known] < _COVERED)),
        *(us, us / before[0].us if before else 1.0),
        shares(np.concatenate([one.status for one in found])),
    )


def cameras_text(rows: Sequence[CamerasRow]) -> str:
    """The table."""
    return table(rows, "one camera and two at right angles: every direction of touch, friction of ± 0.2 rad")
