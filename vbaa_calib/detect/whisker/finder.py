"""Finds the antenna in pictures of one rig: its possible paths are tabled once, a search takes about a millisecond."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np

from vbaa_calib.core.compiled import kernel
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.polyline import arc_lengths, normals, resample

from .acceptance import (
    OTHER_LINE_SEEN,
    best_of,
    better_shaped,
    reject_beside_clamp,
    reject_faint,
    reject_other_shape,
)
from .centreline import Centreline
from .corridor import Corridor
from .path_refinement import RefinedPath, refine_path
from .profile import measure_on

_OTHER_PATH_SHARE = 0.75
"""A second path is measured if its score is at least this share of the best."""
BLURRED_PX = 8.0
"""Blur at which the antenna is looked for once more where it is not found in focus."""
CHANGING_PATHS, CHANGING_SHARE, CHANGING_OTHER = 4, 0.5, 0.85
"""The same where the polarity changes along the antenna: number of paths, share of the best score; and the share of the
first line's visible length from which a second line makes the picture ambiguous."""
_APART = 0.4
"""Fraction of their length over which two paths must differ to be two."""
SAMPLES = 72
"""Samples along a template."""
CONTACTS = (0.12, 0.3, 0.5, 0.7, 0.85, 1.0, 1.8)
"""Where the bending force acts, as fractions of the length; beyond one the bend is nearly an arc."""
_LARGEST_TURN_RAD = 1.75
"""Most that the antenna's direction changes from clamp to tip."""
STEPS = np.array([[0, 1], [1, 1], [1, 0], [1, -1]])
"""(4, 2) steps (u, v) along the normals that ridges are looked for in."""
_UNIT_STEPS = STEPS / np.linalg.norm(STEPS, axis=1, keepdims=True)
_TEXTURE_QUANTILE = 0.8
"""Quantile of the response that is taken as the background's texture."""


@dataclass(frozen=True, eq=False)
class AntennaFinder:
    """Finds the antenna within a corridor, in pictures of one size; prepared once per rig.

    Attributes
    ----------
    corridor : where the antenna may be. image_size : (width, height).
    paths_px : (P, S, 2) those that it may take, from clamp to tip. spacing_px : how far neighbours' tips are apart.
    factor, pool, reach : how far the picture is reduced, its response pooled, and where the flanks are looked at.
    index : (P, S) place of every sample in the flat response.
    weight : (P,) what a path's sum is divided by: how many of its samples are in the picture, but not too few.
    usual_height : of the antenna's line over its background in this rig's pictures, grey levels; 0 where not known.
    """

    corridor: Corridor
    image_size: tuple[int, int]
    paths_px: np.ndarray
    spacing_px: float
    factor: int
    pool: int
    reach: int
    index: np.ndarray
    weight: np.ndarray
    usual_height: float = 0.0

    @staticmethod
    def prepare(corridor: Corridor, image_size: tuple[int, int]) -> AntennaFinder:
        """Table the paths of a corridor."""
        paths, spacing = templates(corridor)
        factor = int(np.clip(corridor.width_px / 2.5, 2, 12))
        pool = int(np.clip(np.ceil(0.5 * spacing / factor), 1, 4))
        reach = max(2, int(np.ceil((0.5 * corridor.width_px + 1.5) / factor)))
        size = np.maximum(np.array(image_size) // factor, 1)
        shape = (int(-(-size[1] // pool)), int(-(-size[0] // pool)))
        index = _places(paths, factor, pool, shape)
        weight = np.maximum((index < 4 * shape[0] * shape[1]).sum(axis=1), 0.3 * index.shape[1])
        return AntennaFinder(corridor, image_size, paths, spacing, factor, pool, reach, index, weight)

    def with_usual_height(self, usual_height: float) -> AntennaFinder:
        """The same finder for a line of known height: the `amplitude` of the free antenna's pictures.

        A bar or edge that looks like an antenna mostly is fainter.
        """
        return replace(self, usual_height=usual_height)

    def candidates(self, image: np.ndarray, bright: bool | None = True, blurred_px: float = 0.0) -> list[np.ndarray]:
        """Paths (K, 2) that look like the antenna in an (H, W) picture, blurred by about so many pixels; best first.

        Up to two that differ and score alike; with `bright` None, which fits more things, up to `CHANGING_PATHS`.
        """
        small = _downsampled(image, self.factor)
        reach = self.reach + int(np.ceil(0.6 * blurred_px / self.factor))
        flat = _ridge_responses(small, reach, self.pool, bright)
        # "wrap" only spares take the check of an index that is known to be good
        total = cv2.reduce(flat.take(self.index, mode="wrap"), 1, cv2.REDUCE_SUM, dtype=cv2.CV_32S).ravel()
        score = total / self.weight
        best = int(score.argmax())
        paths = [self.paths_px[best]]
        count, share = (2, _OTHER_PATH_SHARE) if bright is not None else (CHANGING_PATHS, CHANGING_SHARE)
        others = np.flatnonzero(score >= share * score[best])
        for _ in range(1, count):
            others = others[~self._alike(best, others)]
            if not len(others):
                break
            best = int(others[score[others].argmax()])
            paths.append(self.paths_px[best])
        return paths

    def find(self, image: np.ndarray, bright: bool | None = True) -> Centreline:
        """The centreline in a picture, with its verdict; where there is none in focus, one out of focus.

        image : (H, W) uint8, uint16 or float; colour pictures go through `paint.Paint`. bright : whether the antenna is
        brighter than its surroundings; None: in part. Raises InputError for a picture of another size.
        """
        if image.shape != (self.image_size[1], self.image_size[0]):
            seen, meant = ("x".join(map(str, size)) for size in (image.shape[::-1], self.image_size))
            raise InputError(f"the picture is {seen}, the finder was made for {meant}", remedy="one picture size a rig")
        if image.dtype not in (np.uint8, np.uint16):
            image = np.nan_to_num(image.astype(np.float32), nan=0.0, posinf=0.0, neginf=0.0)
        line = self._look(image, bright, 0.0)
        if line.found or line.verdict == "ambiguous":
            return line
        blurred = self._look(image, bright, BLURRED_PX)
        return blurred if blurred.found and blurred.seen > line.seen else line

    def path(
        self, image: np.ndarray, rough: np.ndarray, bright: bool | None = True, blurred_px: float = 0.0
    ) -> RefinedPath:
        """A rough path (K, 2) moved onto the antenna."""
        reach = 1.2 * self.spacing_px + 0.5 * self.corridor.width_px + 4.0
        width = self.corridor.width_px + blurred_px
        return refine_path(image, rough, width, reach, bright, self.corridor.clamp_px)

    def _look(self, image: np.ndarray, bright: bool | None, blurred_px: float) -> Centreline:
        width = self.corridor.width_px

        def measured(path_px: np.ndarray) -> Centreline:
            line = measure_on(image, path_px, width, bright, blurred_px)
            # a line that may be of either polarity has geometry alone to tell it from others
            line = reject_beside_clamp(line, self.corridor) if bright is None else line
            return reject_other_shape(line, self.corridor)

        lines = []
        for rough in self.candidates(image, bright, blurred_px):
            path = self.path(image, rough, bright, blurred_px)
            line = measured(path.path_px)
            if len(path.other_px) and self.corridor.shape_px is not None:
                line = better_shaped(line, measured(path.other_px), self.corridor)
            lines.append(line)
        alike = OTHER_LINE_SEEN if bright is not None else CHANGING_OTHER
        return reject_faint(best_of(lines, width, alike), self.usual_height)

    def _alike(self, best: int, others: np.ndarray) -> np.ndarray:
        """(Q,) whether those paths are much the same as that one."""
        few = self.paths_px[others, ::8]
        gap = np.abs(few - self.paths_px[best, ::8]).max(axis=-1)
        apart = gap > 2.0 * self.spacing_px + self.corridor.width_px
        return apart.mean(axis=1) < _APART


def sampled_axis(corridor: Corridor) -> tuple[np.ndarray, float]:
    """A corridor's axis (S, 2) in equal steps, and how far apart the tips of neighbouring paths are, px."""
    axis, _ = resample(corridor.axis_px, max(arc_lengths(corridor.axis_px)[-1] / SAMPLES, 1e-3))
    return axis, max(0.9 * float(arc_lengths(axis)[-1]) / (len(axis) - 1), 3.0)


def templates(corridor: Corridor) -> tuple[np.ndarray, float]:
    """Paths (P, S, 2) that fill a corridor, so dense that the antenna is within the spacing, px, of one."""
    axis, spacing = sampled_axis(corridor)
    length = arc_lengths(axis)[-1]
    step = length / (len(axis) - 1)
    tangent = np.gradient(axis, axis=0)
    heading = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    share = np.linspace(0.0, 1.0, len(axis))
    bent = []
    for contact in CONTACTS:
        reach = share / contact
        shape = np.where(reach < 1.0, reach * (2.0 - reach), 1.0)
        shape /= shape[-1]
        turn = np.arange(0.0, _LARGEST_TURN_RAD, spacing / (length * shape.mean()))
        turns = np.concatenate([-turn[:0:-1], turn])
        angle = heading + turns[:, None] * shape
        paths = np.zeros((len(turns), len(axis), 2))
        for side, along in enumerate((np.cos(angle), np.sin(angle))):
            steps = step * along
            np.cumsum(0.5 * (steps[:, :-1] + steps[:, 1:]), axis=1, out=paths[:, 1:, side])
        paths += axis[0]
        bent.append(paths[_within(paths, corridor)])
    return np.concatenate(bent), spacing


def _within(paths: np.ndarray, corridor: Corridor) -> np.ndarray:
    """(P,) whether a path's tip is no farther from the axis' tip than the corridor reaches there."""
    tip = corridor.axis_px[-1]
    across = normals(corridor.axis_px)[-1]
    along = np.array([across[1], -across[0]])
    offset = paths[:, -1] - tip
    return np.abs(offset @ across) <= corridor.reach_px[-1] + np.maximum(0.0, offset @ along)


@kernel
def _places(paths_px: np.ndarray, factor: int, pool: int, shape: tuple[int, int]) -> np.ndarray:
    """(P, S) where the ridge response of each sample stands in `_ridge_responses` of `shape` (rows, columns): that for
    the normal of `STEPS` nearest to the path's; beyond the picture, the last."""
    (rows, columns), count, samples = shape, paths_px.shape[0], paths_px.shape[1]
    index = np.empty((count, samples), np.intp)
    for p in range(count):
        for s in range(samples):
            before, after = max(s - 1, 0), min(s + 1, samples - 1)
            u = paths_px[p, after, 0] - paths_px[p, before, 0]
            v = paths_px[p, after, 1] - paths_px[p, before, 1]
            nearest, most = 0, -1.0
            for step in range(len(_UNIT_STEPS)):
                along = abs(u * _UNIT_STEPS[step, 1] - v * _UNIT_STEPS[step, 0])
                if along > most:
                    nearest, most = step, along
            column = np.rint(((paths_px[p, s, 0] + 0.5) / factor - 0.5) / pool)
            row = np.rint(((paths_px[p, s, 1] + 0.5) / factor - 0.5) / pool)
            inside = 0.0 <= column < columns and 0.0 <= row < rows
            index[p, s] = (nearest * rows + int(row)) * columns + int(column) if inside else 4 * rows * columns
    return index


def _downsampled(image: np.ndarray, factor: int) -> np.ndarray:
    """(h, w) uint8: blocks of `factor` pixels averaged; other depths than 8 bits are stretched to the full range."""
    height, width = image.shape
    size = (max(width // factor, 1), max(height // factor, 1))
    cropped = image[: size[1] * factor, : size[0] * factor] if min(size) > 1 else image
    small = cv2.resize(cropped, size, interpolation=cv2.INTER_AREA)
    if small.dtype == np.uint8:
        return small
    values = np.nan_to_num(np.asarray(small, np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    low, high = float(values.min()), float(values.max())
    return cv2.convertScaleAbs(values - low, alpha=255.0 / max(high - low, 1e-6))


def _ridge_responses(small: np.ndarray, reach: int, pool: int, bright: bool | None = True) -> np.ndarray:
    """(4 · h · w + 1,) uint8 ridge response for the four normals, pooled over `pool` pixels, flat; the last is zero.

    small : (H, W) uint8. The line is `bright`er than both flanks `reach` pixels away, or darker, or, for None, either.
    The response saturates where a ridge is clear: a brighter ridge must not make up for a detour.
    """
    small = 255 - small if bright is False else small
    height, width = small.shape
    framed = cv2.copyMakeBorder(small, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    diagonal = int(np.ceil(reach / np.sqrt(2.0)))
    square = np.ones((2 * pool - 1, 2 * pool - 1), np.uint8)
    shape = (-(-height // pool), -(-width // pool))
    flat = np.zeros(len(STEPS) * shape[0] * shape[1] + 1, np.uint8)
    layers = flat[:-1].reshape(len(STEPS), *shape)
    for step, layer in zip(STEPS.tolist(), layers, strict=True):
        far = diagonal if step[0] and step[1] else reach
        u, v = far * step[0], far * step[1]
        flanks = [
            framed[reach + s * v : reach + s * v + height, reach + s * u : reach + s * u + width] for s in (-1, 1)
        ]
        ridge = cv2.subtract(small, cv2.max(*flanks))
        if bright is None:
            ridge = cv2.max(ridge, cv2.subtract(cv2.min(*flanks), small))
        layer[:] = (cv2.dilate(ridge, square) if pool > 1 else ridge)[::pool, ::pool]
    return cv2.LUT(flat, _saturation(flat)).ravel()


def _saturation(flat: np.ndarray) -> np.ndarray:
    """(256,) lookup table of responses: zero up to the texture's level, saturating at a few times that."""
    few = np.ascontiguousarray(flat[:: 1 + len(flat) // 20_000])
    counts = cv2.calcHist([few], [0], None, [256], [0, 256]).cumsum(dtype=float)
    return _saturating(float(np.searchsorted(counts, _TEXTURE_QUANTILE * counts[-1])) + 1.0)


@lru_cache(maxsize=256)
def _saturating(ordinary: float) -> np.ndarray:
    over = np.maximum(np.arange(256.0) - ordinary, 0.0)
    return np.rint(250.0 * over / (over + 3.0 * ordinary)).astype(np.uint8)
