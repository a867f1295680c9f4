"""What the paper and a ruler make of the benchmark's frames: two points each, and the straight line.

The points come through the metric layer, as for the paper's camera A; which two points lie on which part of the
antenna is told by the truth, which no user has.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estimator.inclined import inclined_two_point_contact, project
from estimator.straight_line import straight_line_contact
from estimator.two_point import two_point_contact

from ..camera import CameraOnPlane
from .estimator_scenes import Scenes

PARTS = {"two curved points": (0.45, 0.95), "two straight points": (1.1, 2.0), "one of each": (0.6, 2.0)}
"""Where the two points are taken: up to 1 in contact distances, the rest as 1 + the share of the straight part."""
CAMERA_B_TILT_RAD = np.radians(30.0)
FIRST_GUESS = 0.7
"""Of the length: beyond it the first straight line is drawn."""


@dataclass(frozen=True, eq=False)
class Baseline:
    """A method made ready for some frames.

    Attributes
    ----------
    name : for people.
    solve : from frames' indices to their contact distances, both (B,); what a user would have to run for each frame.
    """

    name: str
    solve: Callable[[np.ndarray], np.ndarray]


def baselines(scenes: Scenes, rng: np.random.Generator) -> list[Baseline]:
    """Every baseline for these frames, which are noisy already; `rng` for the noise of camera B's pictures."""
    layer, antenna = scenes.rig.camera_on_plane(), scenes.rig.antenna
    stiffness, length = antenna.stiffness_Nm2, antenna.length_m
    ready = [Baseline(name, _two_points(scenes, layer, ends)) for name, ends in PARTS.items()]
    picked = _camera_b(scenes, layer, rng)

    def inclined(which: np.ndarray) -> np.ndarray:
        image = picked[which]
        moment = scenes.moment_Nm[which]
        found = inclined_two_point_contact(image[..., 0], image[..., 1], moment, stiffness, CAMERA_B_TILT_RAD, length)
        return np.asarray(found.contact_m)

    def line(which: np.ndarray) -> np.ndarray:
        x, y = np.moveaxis(layer.project(scenes.points_px[which])[0], -1, 0)
        guess = np.full(len(which), FIRST_GUESS * length)
        return np.asarray(straight_line_contact(x, y, guess, stiffness).contact_m)

    return [*ready, Baseline("one of each, camera B at 30°", inclined), Baseline("straight line", line)]


def at_shares(scenes: Scenes, ends: tuple[float, float]) -> np.ndarray:
    """(B, 2) indices of the points that lie nearest to the places that `PARTS` names."""
    contact, length = scenes.distance_m[:, None], scenes.rig.antenna.length_m
    share = np.array(ends)
    wanted = np.where(share <= 1.0, share * contact, contact + (share - 1.0) * (length - contact))
    return np.round(np.interp(wanted, scenes.arclength_m, np.arange(len(scenes.arclength_m)))).astype(int)


def _two_points(scenes: Scenes, layer: CameraOnPlane, ends: tuple[float, float]) -> Callable[[np.ndarray], np.ndarray]:
    pixels = np.take_along_axis(scenes.points_px, at_shares(scenes, ends)[..., None], axis=1)
    stiffness, length = scenes.rig.antenna.stiffness_Nm2, scenes.rig.antenna.length_m

    def solve(which: np.ndarray) -> np.ndarray:
        plane = layer.project(pixels[which])[0]
        return np.asarray(two_point_contact(plane[..., 0], plane[..., 1], stiffness, length).contact_m)

    return solve


def _camera_b(scenes: Scenes, layer: CameraOnPlane, rng: np.random.Generator) -> np.ndarray:
    """(B, 2, 2) of the points "one of each" as the paper's orthographic camera B would see them.

    The benchmark's cameras are perspective ones, for which the inclined formulas were not made. The noise is what the
    points have on plane C through the real camera.
    """
    which = at_shares(scenes, PARTS["one of each"])
    points = np.take_along_axis(scenes.shapes.points_m, which[..., None], axis=1)
    middle = np.nanmean(scenes.points_px, axis=(0, 1))
    a, b = layer.project(middle + np.array([[-0.5, 0.0], [0.5, 0.0]]))[0]
    m_per_px = float(np.linalg.norm(b - a))
    image = np.asarray(project(points, CAMERA_B_TILT_RAD))
    return image + rng.normal(0.0, scenes.sigma_px * m_per_px, image.shape)
