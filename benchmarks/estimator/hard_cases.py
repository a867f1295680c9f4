"""Frames of the estimator's hard cases: every border of what can be known, every way in which a frame can be poor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.geometry import Pose
from vbaa_calib.rig import Rig

from .scenes import Scenes, push_for_deflection, push_for_slope, rolled, scenes
from .setup import ACROSS, LENGTH_M, SIGMA_PX, TOWARDS_CLAMP, Setup, looking_pose

Rng = np.random.Generator
ORDINARY_M = 0.006
"""Deflection at the contact where a case is hard for something else."""


@dataclass(frozen=True, eq=False)
class Hard:
    """Frames of one case, noisy: what the estimator is given beyond the scenes themselves."""

    scenes: Scenes
    with_moment: bool = True
    single: bool = False

    @property
    def points_px(self) -> np.ndarray:
        """(B, N, 2), of the kind that the case is about."""
        return self.scenes.points_px.astype(np.float32) if self.single else self.scenes.points_px


Maker = Callable[[int, Rng], Hard]


def _touched(
    rig: Rig, rng: Rng, count: int, reach: tuple[float, float] = (0.3, 0.8), deflection_m: float = ORDINARY_M
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances (B,), size of the pushes (B,) and rolls (B,)."""
    antenna = rig.antenna
    distance = rng.uniform(*reach, count) * antenna.length_m
    deflection = np.minimum(deflection_m * antenna.length_m / LENGTH_M, 0.15 * distance)
    return distance, push_for_deflection(deflection, distance, antenna.stiffness_Nm2), rng.uniform(-1.0, 1.0, count)


def _ordinary(
    count: int,
    rng: Rng,
    setup: Setup | None = None,
    roll_rad: float | None = None,
    rig: Rig | None = None,
    reach: tuple[float, float] = (0.3, 0.8),
    deflection_m: float = ORDINARY_M,
) -> Scenes:
    rig = (setup or Setup()).rig() if rig is None else rig
    distance, size, roll = _touched(rig, rng, count, reach, deflection_m)
    return scenes(rig, distance, rolled(size, roll if roll_rad is None else roll_rad)).noisy(rng)


def _near_the_clamp(count: int, rng: Rng) -> Hard:
    """l from 1 to 5 % of the length."""
    return Hard(_ordinary(count, rng, reach=(0.01, 0.05)))


def _near_the_tip(count: int, rng: Rng) -> Hard:
    """l from 97 % of the length on."""
    return Hard(_ordinary(count, rng, reach=(0.97, 1.0)))


def _hardly_bent(count: int, rng: Rng) -> Hard:
    """Deflections at the contact of about one deviation of a point."""
    return Hard(_ordinary(count, rng, deflection_m=3e-5))


def coincident(count: int, rng: Rng) -> Hard:
    """All points in one place."""
    frames = _ordinary(count, rng)
    one = np.repeat(frames.points_px[:, 150:151], frames.points_px.shape[1], axis=1)
    return Hard(replace(frames, points_px=one + rng.normal(0.0, SIGMA_PX, one.shape)))


def _before_the_contact(count: int, rng: Rng) -> Hard:
    """Only points on the curved part."""
    frames = _ordinary(count, rng)
    return Hard(_hidden(frames, frames.arclength_m > frames.distance_m[:, None]))


def _beyond_the_contact(count: int, rng: Rng) -> Hard:
    """Only points on the straight part."""
    frames = _ordinary(count, rng)
    return Hard(_hidden(frames, frames.arclength_m < frames.distance_m[:, None]))


def _along_the_sight(count: int, rng: Rng) -> Hard:
    """ξ = 90° under the upright camera: all bending is towards it."""
    return Hard(_ordinary(count, rng, roll_rad=np.pi / 2))


def _lying_camera(count: int, rng: Rng) -> Hard:
    """A camera that looks along the antenna, 87° inclined."""
    return Hard(_ordinary(count, rng, Setup(tilt_rad=np.radians(87.0), azimuth_rad=TOWARDS_CLAMP)))


def _edge_on(count: int, rng: Rng) -> Hard:
    """The camera's centre within 0.02 rad of the deformation plane."""
    rig = Setup(tilt_rad=np.radians(40.0), azimuth_rad=ACROSS).rig()
    centre = rig.T_antenna_camera.translation_m
    distance, size, _ = _touched(rig, rng, count)
    roll = np.arctan2(centre[2], centre[1]) + rng.uniform(-0.02, 0.02, count)
    return Hard(scenes(rig, distance, rolled(size, roll)).noisy(rng))


def _close_by(count: int, rng: Rng) -> Hard:
    """A camera 60 mm from the antenna, which sees the middle of it."""
    rig = replace(Setup().rig(), T_antenna_camera=looking_pose(0.2, TOWARDS_CLAMP, 0.06))
    return Hard(_ordinary(count, rng, rig=rig))


def _no_moment_there(count: int, rng: Rng) -> Hard:
    """τ = 0: no force along z."""
    return Hard(_ordinary(count, rng, roll_rad=0.0))


def _no_sensor(count: int, rng: Rng) -> Hard:
    """Vision alone, camera inclined by 45°."""
    return Hard(_ordinary(count, rng, Setup(tilt_rad=np.radians(45.0))), with_moment=False)


def _no_sensor_upright(count: int, rng: Rng) -> Hard:
    """Vision alone by the camera that sees least of f_z."""
    return Hard(_ordinary(count, rng), with_moment=False)


def _huge_load(count: int, rng: Rng) -> Hard:
    """Slopes of 45 to 75° at the contact."""
    rig = Setup(swing_m=0.15).rig()
    distance, _, roll = _touched(rig, rng, count)
    size = push_for_slope(np.radians(rng.uniform(45.0, 75.0, count)), distance, rig.antenna.stiffness_Nm2)
    return Hard(scenes(rig, distance, rolled(size, roll)).noisy(rng))


def _few_points(points: int) -> Maker:
    """So many points, evenly over the antenna."""

    def make(count: int, rng: Rng) -> Hard:
        frames = _ordinary(count, rng)
        kept = np.linspace(20, frames.points_px.shape[1] - 1, points).astype(int)
        return Hard(_hidden(frames, ~np.isin(np.arange(frames.points_px.shape[1]), kept)))

    return make


def missing(count: int, rng: Rng) -> Hard:
    """40 % of the points missing."""
    frames = _ordinary(count, rng)
    return Hard(_hidden(frames, rng.random(frames.points_px.shape[:2]) < 0.4))


def outliers(count: int, rng: Rng) -> Hard:
    """20 % of the points up to 50 px off."""
    frames = _ordinary(count, rng)
    return Hard(with_outliers(frames, 0.2, rng))


def _single_precision(count: int, rng: Rng) -> Hard:
    """Pixels in float32."""
    return Hard(_ordinary(count, rng), single=True)


def _of_size(factor: float) -> Maker:
    """The same scene so many times larger, in everything but the picture."""

    def make(count: int, rng: Rng) -> Hard:
        return Hard(_ordinary(count, rng, rig=resized(Setup().rig(), factor)))

    return make


CASES: dict[str, Maker] = {
    "l → 0": _near_the_clamp,
    "l → L": _near_the_tip,
    "δ → 0": _hardly_bent,
    "all points in one place": coincident,
    "points before the contact only": _before_the_contact,
    "points beyond the contact only": _beyond_the_contact,
    "ξ = 90°, upright camera": _along_the_sight,
    "camera inclined by 87°": _lying_camera,
    "camera's centre almost in 𝒟": _edge_on,
    "camera 60 mm away": _close_by,
    "τ = 0": _no_moment_there,
    "no sensor, camera at 45°": _no_sensor,
    "no sensor, upright camera": _no_sensor_upright,
    "slopes of 45 to 75°": _huge_load,
    "2 points": _few_points(2),
    "3 points": _few_points(3),
    "5 points": _few_points(5),
    "40 % missing": missing,
    "20 % outliers": outliers,
    "float32 pixels": _single_precision,
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
    return replace(
        rig,
        T_antenna_camera=Pose(pose.rotation, factor * pose.translation_m),
        antenna=replace(
            antenna,
            length_m=factor * antenna.length_m,
            diameter_m=factor * antenna.diameter_m,
            parameters=parameters,
        ),
        moment_sensor=replace(sensor, std_Nm=factor * sensor.std_Nm),
    )


def _hidden(frames: Scenes, hidden: np.ndarray) -> Scenes:
    """Without the points (N,) or (B, N)."""
    return replace(frames, points_px=np.where(hidden[..., None], np.nan, frames.points_px))
