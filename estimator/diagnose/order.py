"""Pictures that are exchanged between rows, by how smoothly pictures and readings follow each other."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from vbaa_calib.rig import Rig

from .settings import RecordingSettings


class PicturedRow(NamedTuple):
    """A row's picture in few numbers.

    lateral_px : (K,) how far the antenna lies from its straight line at places along it; NaN where it is not seen.
    sigma_px : of its points. readings : (8,) as they were read, pan and tilt last.
    """

    row: int
    lateral_px: np.ndarray
    sigma_px: float
    readings: np.ndarray


class Jump(NamedTuple):
    """A picture that lies off the mean of its neighbours as far as these are apart, while the readings go on smoothly.

    size_px : how far. around : (K,) as `PicturedRow.lateral_px`, mean of the neighbours.
    """

    row: int
    lateral_px: np.ndarray
    around: np.ndarray
    size_px: float


def lateral_px(rig: Rig, points_px: np.ndarray) -> np.ndarray:
    """(K,) distances of a line's points (N, 2) from the image of the antenna's x axis, at places along that."""
    ends = np.array([[0.0, 0.0, 0.0], [rig.antenna.length_m, 0.0, 0.0]])
    (clamp, tip), valid = rig.camera.project(rig.T_antenna_camera.inverse() @ ends)
    found = np.full(RecordingSettings.places, np.nan)
    points = points_px[np.isfinite(points_px).all(axis=1)]
    if not valid.all() or len(points) < RecordingSettings.fewest_points:
        return found
    along = (tip - clamp) / np.linalg.norm(tip - clamp)
    at, off = (points - clamp) @ along, (points - clamp) @ [-along[1], along[0]]
    order = np.argsort(at)
    places = np.linspace(0.0, 1.0, len(found) + 1)[1:] * np.linalg.norm(tip - clamp)
    return np.interp(places, at[order], off[order], left=np.nan, right=np.nan)


def jump(three: Sequence[PicturedRow], moment_std_Nm: float) -> Jump | None:
    """The second of three rows in order, if it is one; the sensor's noise is what readings may scatter by."""
    settings, (before, now, after) = RecordingSettings(), three
    around = 0.5 * (before.lateral_px + after.lateral_px)
    size, apart = _unlike(now.lateral_px, around), _unlike(before.lateral_px, after.lateral_px)
    if not (size > settings.jumps * apart and size > settings.jump_sigma * now.sigma_px):
        return None
    off = np.abs(now.readings - 0.5 * (before.readings + after.readings))
    noise = np.where(np.arange(len(off)) < len(off) - 2, settings.varies_std * moment_std_Nm, settings.varies_rad)
    smooth = off <= np.abs(before.readings - after.readings) + noise
    return Jump(now.row, now.lateral_px, around, size) if smooth[np.isfinite(off)].all() else None


def exchanged(jumps: Sequence[Jump]) -> list[tuple[int, int]]:
    """Rows each of whose pictures fits between the neighbours of the other, each row once, in the best pair."""
    pairs = []
    for one, other in combinations(jumps, 2):
        left = max(_unlike(one.lateral_px, other.around), _unlike(other.lateral_px, one.around))
        pairs.append((left / min(one.size_px, other.size_px), one.row, other.row))
    found: list[tuple[int, int]] = []
    for _, *rows in sorted(pair for pair in pairs if pair[0] < RecordingSettings.fits):
        if not {row for pair in found for row in pair} & set(rows):
            found.append((rows[0], rows[1]))
    return found


def _unlike(one_px: np.ndarray, other_px: np.ndarray) -> float:
    """Rms distance of two lines where both are seen; NaN where that is hardly anywhere."""
    off = (one_px - other_px)[np.isfinite(one_px - other_px)]
    return float(np.sqrt(np.mean(off**2))) if len(off) >= RecordingSettings.fewest_places else float("nan")
