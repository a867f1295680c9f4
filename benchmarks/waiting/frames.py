"""Frames as users have them, with their bound; and some that fit nothing."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from benchmarks.chain.scenes import cell
from benchmarks.estimator.bound import bound
from benchmarks.estimator.scenes import Scenes, joined, push_for_deflection, rod_shapes, rolled, scenes
from benchmarks.estimator.setup import drawn_truth
from vbaa_calib.rig import Rig

REACH, DEFLECTION_M, ROLL_RAD = (0.3, 0.8), (0.004, 0.008), np.radians(60.0)
"""Contact distances over length, deflections there, and the largest roll of the deformation plane."""
JOINTS_RAD = 0.4
"""Pan and tilt lie within ± this."""
RUBBED = 0.5
"""Share of the frames with friction, where there is any."""
TRUE_RIGS = 20
SIZE = 1280, 720
"""Of pictures, px."""


@dataclass(frozen=True, eq=False)
class Judged:
    """Noisy frames with their bound (B,) m."""

    scenes: Scenes
    bound_m: np.ndarray

    @property
    def given(self) -> dict[str, np.ndarray]:
        """What the estimator is given."""
        return {name: getattr(self.scenes, name) for name in ("points_px", "moment_Nm", "pan_rad", "tilt_rad")}


@lru_cache(maxsize=8)
def population(
    rig: Rig,
    frames: int,
    seed: int,
    friction_rad: float = 0.0,
    points: int = 200,
) -> Judged:
    """Noisy frames of the static rod, rolls evenly up to 60°, half of them with friction of that deviation.

    Of a rig that is not exactly known several true ones take part, each one draw of its covariance away.
    """
    rng, antenna, exact = np.random.default_rng((seed, points)), rig.antenna, not rig.covariance.any()
    distance = rng.uniform(*REACH, frames) * antenna.length_m
    size = push_for_deflection(rng.uniform(*DEFLECTION_M, frames), distance, antenna.stiffness_Nm2)
    size = np.nan_to_num(size) * rng.choice([-1.0, 1.0], frames)
    push = rolled(size, rng.uniform(-ROLL_RAD, ROLL_RAD, frames))
    friction = friction_rad * rng.normal(size=frames) * (rng.random(frames) < RUBBED)
    joints = rng.uniform(-JOINTS_RAD, JOINTS_RAD, (2, frames))

    def seen(truth: Rig, own: np.ndarray) -> Scenes:
        pan, tilt = joints[:, own]
        how: dict[str, Any] = {"made_by": rod_shapes, "sigma_px": rig.image.noise_px, "points": points, "given": rig}
        return scenes(truth, distance[own], push[own], friction[own], pan_rad=pan, tilt_rad=tilt, **how)

    every = np.arange(frames)
    parts = [
        seen(rig if exact else drawn_truth(rig, rng), own).noisy(rng)
        for own in np.array_split(every, 1 if exact else min(TRUE_RIGS, frames))
    ]
    return Judged(joined(parts), bound(seen(rig, every), friction_rad).std[:, 0])


def photographed(count: int, seed: int) -> tuple[Rig, dict[str, np.ndarray]]:
    """Pictures in memory with what is read beside them, and the rig that is calibrated for them."""
    pages = cell(SIZE, "calibrated", count, seed)
    truths = [one.truth for one in pages.photographs]
    return pages.rig, {
        "images": np.array([one.image for one in pages.photographs]),
        "moment_Nm": np.array([one.moment_Nm for one in pages.photographs]),
        "pan_rad": np.concatenate([one.pan_rad for one in truths]),
        "tilt_rad": np.concatenate([one.tilt_rad for one in truths]),
    }
