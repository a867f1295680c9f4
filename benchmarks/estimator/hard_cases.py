"""Frames of the estimator's hard cases: every limit of what can be known, every way in which a frame can be poor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vbaa_calib.geometry import Pose
from vbaa_calib.rig import Rig

from .scenes import Scenes, push_for_deflection, push_for_slope, rolled, scenes
from .setup import ACROSS, LENGTH_M, SIGMA_PX, TOWARDS_CLAMP, Setup, looking_pose

Rng = np.random.Generator
Maker = Callable[[int, Rng], "Hard"]
_ORDINARY_M = 0.006
"""Deflection at the contact where a case is hard for something else."""


@dataclass(frozen=True, eq=False)
class Hard:
    """Frames of one case, noisy, and how the estimator is given them."""

    scenes: Scenes
    with_moment: bool = True
    single: bool = False

    @property
    def points_px(self) -> np.ndarray:
        """(B, N, 2), in single precision where the case asks for it."""
        return self.scenes.points_px.astype(np.float32) if self.single else self.scenes.points_px


def _touched(
    rig: Rig, rng: Rng, count: int, reach: tuple[float, float] = (0.3, 0.8), deflection_m: float = _ORDINARY_M
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances (B,), size of the pushes (B,) and rolls (B,)."""
    antenna = rig.antenna
    distance = rng.uniform(*reach, count) * antenna.length_m
    deflection = np.minimum(deflection_m * antenna.length_m / LENGTH_M, 0.15 * distance)
    return distance, push_for_deflection(deflection, distance, antenna.stiffness_Nm2), rng.uniform(-1.0, 1.0, count)


def _ordinary(count: int, rng: Rng, rig: Rig | None = None, roll_rad: float | None = None, **touch: Any) -> Scenes:
    rig = Setup().rig() if rig is None else rig
    distance, size, roll = _touched(rig, rng, count, **touch)
    return scenes(rig, distance, rolled(size, roll if roll_rad is None else roll_rad)).noisy(rng)


def _edge_on(count: int, rng: Rng) -> Hard:
    """The camera's centre within 0.02 rad of the deformation plane."""
    rig = Setup(tilt_rad=np.radians(40.0), azimuth_rad=ACROSS).rig()
    centre = rig.T_antenna_camera.translation_m
    distance, size, _ = _touched(rig, rng, count)
    roll = np.arctan2(centre[2], centre[1]) + rng.uniform(-0.02, 0.02, count)
    return Hard(scenes(rig, distance, rolled(size, roll)).noisy(rng))


def _huge_load(count: int, rng: Rng) -> Hard:
    rig = Setup(swing_m=0.15).rig()
    distance, _, roll = _touched(rig, rng, count)
    size = push_for_slope(np.radians(rng.uniform(45.0, 75.0, count)), distance, rig.antenna.stiffness_Nm2)
    return Hard(scenes(rig, distance, rolled(size, roll)).noisy(rng))


def _coincident(count: int, rng: Rng) -> Hard:
    frames = _ordinary(count, rng)
    one = np.repeat(frames.points_px[:, 150:151], frames.points_px.shape[1], axis=1)
    return Hard(replace(frames, points_px=one + rng.normal(0.0, SIGMA_PX, one.shape)))


def _with(**how: Any) -> Maker:
    """Ordinary frames, but for the rig, the roll, the reach or the deflection."""
    setup = how.pop("setup", Setup())
    return lambda count, rng: Hard(_ordinary(count, rng, setup.rig(), **how))


def _without(hidden: Callable[[Scenes, Rng], np.ndarray]) -> Maker:
    """Ordinary frames without the points (N,) or (B, N) that a function names."""

    def make(count: int, rng: Rng) -> Hard:
        frames = _ordinary(count, rng)
        return Hard(replace(frames, points_px=np.where(hidden(frames, rng)[..., None], np.nan, frames.points_px)))

    return make


def _few_points(points: int) -> Maker:
    def hidden(frames: Scenes, _: Rng) -> np.ndarray:
        count = frames.points_px.shape[1]
        return ~np.isin(np.arange(count), np.linspace(20, count - 1, points).astype(int))

    return _without(hidden)


def _vision_alone(setup: Setup) -> Maker:
    return lambda count, rng: Hard(_ordinary(count, rng, setup.rig()), with_moment=False)


def _of_size(factor: float) -> Maker:
    return lambda count, rng: Hard(_ordinary(count, rng, resized(Setup().rig(), factor)))


def _close_by(count: int, rng: Rng) -> Hard:
    rig = replace(Setup().rig(), T_antenna_camera=looking_pose(0.2, TOWARDS_CLAMP, 0.06))
    return Hard(_ordinary(count, rng, rig))


CASES: dict[str, Maker] = {
    "l → 0": _with(reach=(0.01, 0.05)),
    "l → L": _with(reach=(0.97, 1.0)),
    "δ → 0": _with(deflection_m=3e-5),
    "all points in one place": _coincident,
    "points before the contact only": _without(lambda frames, _: frames.arclength_m > frames.distance_m[:, None]),
    "points beyond the contact only": _without(lambda frames, _: frames.arclength_m < frames.distance_m[:, None]),
    "ξ = 90°, upright camera": _with(roll_rad=np.pi / 2),
    "camera inclined by 87°": _with(setup=Setup(tilt_rad=np.radians(87.0))),
    "camera's centre almost in 𝒟": _edge_on,
    "camera 60 mm away": _close_by,
    "τ = 0": _with(roll_rad=0.0),
    "no sensor, camera at 45°": _vision_alone(Setup(tilt_rad=np.radians(45.0))),
    "no sensor, upright camera": _vision_alone(Setup()),
    "slopes of 45 to 75°": _huge_load,
    "2 points": _few_points(2),
    "3 points": _few_points(3),
    "5 points": _few_points(5),
    "40 % missing": _without(lambda frames, rng: rng.random(frames.points_px.shape[:2]) < 0.4),
    "20 % outliers": lambda count, rng: Hard(with_outliers(_ordinary(count, rng), 0.2, rng)),
    "float32 pixels": lambda count, rng: Hard(_ordinary(count, rng), single=True),
    "1000 times larger": _of_size(1e3),
    "1000 times smaller": _of_size(1e-3),
}
"""Name → what makes its frames."""


def with_outliers(frames: Scenes, share: np.ndarray | float, rng: Rng, reach_px: float = 50.0) -> Scenes:
    """Frames of whose points a share, () or (B, 1), lies up to `reach_px` off along u and v."""
    points = frames.points_px
    off = rng.uniform(-reach_px, reach_px, points.shape)
    return replace(frames, points_px=np.where((rng.random(points.shape[:2]) < share)[..., None], points + off, points))


def resized(rig: Rig, factor: float) -> Rig:
    """A weightless rig in which all lengths are multiplied, forces stay, and so does the picture."""
    antenna, sensor, pose = rig.antenna, rig.moment_sensor, rig.T_antenna_camera
    parameters = antenna.parameters.copy()
    parameters[6] += 2.0 * np.log(factor)
    length, diameter = factor * antenna.length_m, factor * antenna.diameter_m
    return replace(
        rig,
        T_antenna_camera=Pose(pose.rotation, factor * pose.translation_m),
        antenna=replace(antenna, length_m=length, diameter_m=diameter, parameters=parameters),
        moment_sensor=replace(sensor, std_Nm=factor * sensor.std_Nm),
    )
