"""The limit of error: the Cramér–Rao bound of the contact from a picture's pixels.

A picture's information about the antenna's place across itself is worked out column by column from its noise, and
carried to the contact by the bound of the estimator's benchmark, the moment's reading with it. Held as known: the
antenna's cross-section, blur, the pixels' variance, and all of the rig that its covariance does not free. Unknown in
every column: the line's height, level and slope of the background. Not used: the tip's end and the brightness along.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.estimator.bound import Bound, bound
from benchmarks.estimator.scenes import Scenes, seen
from benchmarks.estimator.shapes import rod_shapes
from benchmarks.harness import concatenated

from .scenes import FRICTION_STD_RAD, Drawing, Photograph

POINTS = 200
STEP_PX = 0.05


@dataclass(frozen=True, eq=False)
class Information:
    """What every column of one picture says.

    Attributes
    ----------
    column : (C,) int. share : (C,) where along the antenna it is crossed, 0 at the clamp to 1 at the tip.
    per_px2 : (C,) inverse variance of the place across the antenna, px⁻².
    """

    column: np.ndarray
    share: np.ndarray
    per_px2: np.ndarray

    @property
    def sigma_px(self) -> np.ndarray:
        """(C,) least standard deviation of the place across the antenna."""
        return 1.0 / np.sqrt(self.per_px2)


def information(drawing: Drawing, arclength_m: np.ndarray, pixels: np.ndarray) -> Information:
    """Of a picture whose antenna runs along u, through pixels (N, 2) at arc lengths (N,) from clamp to tip."""
    whole = drawing.light()
    slope = (drawing.light(STEP_PX) - drawing.light(-STEP_PX)) / (2.0 * STEP_PX)
    height, width = whole.shape
    column = np.arange(max(int(np.ceil(pixels[0, 0])), 0), min(int(pixels[-1, 0]), width - 1) + 1)
    row = np.interp(column, pixels[:, 0], pixels[:, 1])
    column, row = (values[(row >= 0) & (row <= height - 1)] for values in (column, row))
    # so far that a longer profile would tell the background's slope, and with it the place, no better
    reach = 3 * int(np.ceil(drawing.tube.half_width_px.max() + 4.0 * drawing.studio.spec.blur_px + 2.0))
    rows = np.rint(row).astype(int)[:, None] + np.arange(-reach, reach + 1)
    there = (rows >= 0) & (rows < height)
    at = np.clip(rows, 0, height - 1), column[:, None]
    weight = there / np.sqrt(drawing.variance(whole)[at])
    line = whole[at] - drawing.light(antenna=False)[at]
    aside = np.broadcast_to(np.arange(-reach, reach + 1) / reach, line.shape)
    unknown = np.stack([np.ones_like(line), aside, line], axis=-1) * weight[..., None]
    signal = slope[at] * weight
    left = signal - np.einsum("ctk,ck->ct", unknown, _least_squares(unknown, signal))
    share = np.interp(column, pixels[:, 0], arclength_m) / arclength_m[-1]
    return Information(column, share, (left**2).sum(axis=1))


def _least_squares(columns: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(C, K) coefficients of columns (C, T, K) that come nearest to (C, T)."""
    normal = np.einsum("ctk,ctl->ckl", columns, columns)
    return np.linalg.solve(normal, np.einsum("ctk,ct->ck", columns, wanted)[..., None])[..., 0]


def information_of(photograph: Photograph) -> Information:
    """Of one of the benchmark's pictures."""
    truth = photograph.truth
    arclength = np.linspace(0.0, truth.rig.antenna.length_m, 4 * POINTS)
    points = rod_shapes(truth.rig, truth.touches, arclength).points_m[0]
    return information(photograph.drawing, arclength, seen(truth.rig.camera, truth.rig.T_antenna_camera, points, True))


def equal_information(known: Sequence[Information], points: int = POINTS) -> tuple[np.ndarray, float]:
    """Places (N,) along the antenna between which there is equally much information, on average over pictures, and
    the standard deviation in px of a point at each that carries the information around it."""
    grid = np.linspace(0.0, 1.0, 2001)
    summed = np.mean([_summed(one, grid) for one in known], axis=0)
    places = np.interp((np.arange(points) + 0.5) / points * summed[-1], summed, grid)
    return places, float(np.sqrt(points / summed[-1]))


def _summed(known: Information, grid: np.ndarray) -> np.ndarray:
    """(G,) information, px⁻², from the clamp up to each place."""
    total = np.concatenate([[0.0], np.cumsum(known.per_px2)])
    edges = np.concatenate([known.share[:1], (known.share[1:] + known.share[:-1]) / 2, known.share[-1:]])
    return np.interp(grid, edges, total)


def frames_at_information(truths: Sequence[Scenes], known: Sequence[Information]) -> Scenes:
    """Frames of one rig, their points where `equal_information` puts them, without noise, with that deviation.

    Every picture is taken to tell as much as the mean of them, which they do to a few percent.
    """
    places, sigma_px = equal_information(known)
    touches = concatenated([one.touches for one in truths])
    return at_places(replace(truths[0], touches=touches, sigma_px=sigma_px), places)


def at_places(scenes: Scenes, places: np.ndarray) -> Scenes:
    """Frames of the touches that these have, without noise, seen at places (N,) along the antenna."""
    rig, touches = scenes.rig, scenes.touches
    arclength = places * rig.antenna.length_m
    shapes = rod_shapes(rig, touches, arclength)
    return replace(
        scenes,
        points_px=seen(rig.camera, rig.T_antenna_camera, shapes.points_m),
        moment_Nm=rig.moment_sensor.gain * shapes.moment_Nm + rig.moment_sensor.offset_Nm,
        pan_rad=np.full(len(touches), scenes.pan_rad[0]),
        tilt_rad=np.full(len(touches), scenes.tilt_rad[0]),
        shapes=shapes,
        arclength_m=arclength,
    )


def contact_bound(scenes: Scenes) -> Bound:
    """Of frames of `frames_at_information`."""
    return bound(scenes, FRICTION_STD_RAD)
