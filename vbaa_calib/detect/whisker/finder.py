"""Finds the antenna in pictures of one rig: its possible paths are tabled once, a search takes about a millisecond."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from vbaa_calib.core.compiled import kernel
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.polyline import arc_lengths, followed, normals, resample

from .acceptance import OTHER_LINE_SEEN, best_of, reject_faint
from .centreline import Centreline
from .corridor import Corridor, better_shaped, less_sure, of_antennas_shape
from .crossings import too_short
from .path_refinement import NOTHING_KNOWN, Known, RefinedPath, refine_path
from .profile import measure, measure_on

_OTHER_PATH_SHARE = 0.75
"""A second path is measured if its score is at least this share of the best."""
BLURRED_PX = 8.0
"""Blur at which the antenna is looked for once more where it is not found in focus."""
CHANGING_PATHS, CHANGING_SHARE, CHANGING_OTHER = 4, 0.5, 0.85
"""The same where the polarity changes along the antenna: number of paths, share of the best score; and the share of the
first line's visible length from which a second line makes the picture ambiguous."""
CLEAREST = 3
"""So many of these are measured where it is known how bright the antenna is."""
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
    levels : (L, 2) how bright it usually is, see `Known`; (0, 2) where not known.
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
    levels: np.ndarray = field(default_factory=lambda: NOTHING_KNOWN.levels)

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

    def unlit(self) -> AntennaFinder:
        """The same finder where the antenna is not as bright as usual."""
        return replace(self, levels=NOTHING_KNOWN.levels)

    def candidates(self, image: np.ndarray, bright: bool | None = True, blurred_px: float = 0.0) -> list[np.ndarray]:
        """Paths (K, 2) that look like the antenna in an (H, W) picture, blurred by about so many pixels; best first.

        Up to two that differ and score alike; with `bright` None, which fits more things, up to `CHANGING_PATHS`.
        """
        reach = self.reach + int(np.ceil(0.6 * blurred_px / self.factor))
        sign = 0 if bright is None else 1 if bright else -1
        flat = _ridge_responses(_downsampled(image, self.factor), reach, self.pool, sign)
        score = _scores(flat, self.index, self.weight)
        count, share = (2, _OTHER_PATH_SHARE) if bright is not None else (CHANGING_PATHS, CHANGING_SHARE)
        apart_px = 2.0 * self.spacing_px + self.corridor.width_px
        return [self.paths_px[one] for one in _clearest(score, self.paths_px, apart_px, count, share)]

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
        return refine_path(image, rough, width, reach, bright, self._known(bright))

    def _known(self, bright: bool | None) -> Known:
        """What helps to find a line of this polarity: how bright it is only where that changes."""
        levels = self.levels if bright is None else NOTHING_KNOWN.levels
        return Known(self.corridor.clamp_px, levels, self.corridor.shape_px is not None)

    def along(self, image: np.ndarray, guide_px: np.ndarray, width_px: float, bright: bool | None) -> Centreline:
        """The line measured near a guide (K, 2), where the antenna, so wide, is about a width off at most."""
        guide_px = followed(guide_px, self.image_size)
        if bright is not None or too_short(guide_px):
            return measure(image, guide_px, width_px, bright)
        path = refine_path(image, guide_px, width_px, width_px + 2.0, None, self._known(None))
        return replace(self, corridor=replace(self.corridor, width_px=width_px)).measured(image, path.path_px, None)

    def measured(
        self, image: np.ndarray, path_px: np.ndarray, bright: bool | None, blurred_px: float = 0.0
    ) -> Centreline:
        """The line along a path (K, 2) near the antenna.

        Where the polarity changes, on a rig that is calibrated, the shape that the antenna can take near the path is
        gone along: a path is drawn aside by what lies near the antenna.
        """
        where, width = self.corridor, self.corridor.width_px
        if bright is not None or where.shape_px is None:
            return measure_on(image, path_px, width, bright, blurred_px, self._known(bright))
        lines, points, sigma = [], path_px, np.ones(len(path_px))
        for _ in range(2):
            along = where.nearest(points, sigma)
            if too_short(along):
                along = path_px
            lines.append(measure_on(image, along, width, None, blurred_px, self._known(None)))
            points, sigma = lines[-1].points_px, lines[-1].sigma_px
            if too_short(points):
                break
        return better_shaped(lines[0], lines[-1], where)

    def _look(self, image: np.ndarray, bright: bool | None, blurred_px: float) -> Centreline:
        paths = [self.path(image, rough, bright, blurred_px) for rough in self.candidates(image, bright, blurred_px)]
        if len(self.levels) and bright is None:
            paths = sorted(paths, key=lambda path: -path.clear)[:CLEAREST]
        lines = []
        for path in paths:
            line, *other = (
                of_antennas_shape(self.measured(image, each, bright, blurred_px), self.corridor, bright is None)
                for each in (path.path_px, path.other_px)
                if len(each)
            )
            if other and self.corridor.shape_px is not None:
                line = better_shaped(line, other[0], self.corridor)
            lines.append(line)
        alike = OTHER_LINE_SEEN if bright is not None else CHANGING_OTHER
        line = reject_faint(best_of(lines, self.corridor.width_px, alike), self.usual_height)
        return less_sure(line, self.corridor) if bright is None else line


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
    index = np.empty((count, samples), np.int32)
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


@kernel
def _ridge_responses(small: np.ndarray, reach: int, pool: int, sign: int) -> np.ndarray:
    """(4 · h · w + 1,) uint8 ridge response for the four normals, pooled over `pool` pixels, flat; the last is zero.

    small : (H, W) uint8. The line is brighter than both flanks `reach` pixels away, with a `sign` of −1 darker, or, for
    0, either.
    """
    height, width = small.shape
    # all rows in one, so that loops are long; around them, room for flanks and neighbours
    room = max(reach, pool)
    stride, rows, columns = width + 2 * room, -(-height // pool), -(-width // pool)
    framed = np.empty((height + 2 * room, stride), np.uint8)
    for r in range(len(framed)):
        own, to = small[min(max(r - room, 0), height - 1)], framed[r]
        to[:room], to[room : room + width], to[room + width :] = own[0], own, own[-1]
    if sign < 0:
        framed = ~framed
    level, ridge = framed.ravel(), np.zeros(framed.size, np.uint8)
    tall, high = np.empty(rows * stride, np.uint8), np.empty(rows * stride, np.uint8)
    flat = np.zeros(len(STEPS) * rows * columns + 1, np.uint8)
    diagonal, first, last = int(np.ceil(reach / np.sqrt(2.0))), room * (stride + 1), framed.size - room * (stride + 1)
    for step in range(len(STEPS)):
        far = diagonal if STEPS[step, 0] != 0 and STEPS[step, 1] != 0 else reach
        off = far * (STEPS[step, 1] * stride + STEPS[step, 0])
        own, one, other = level[first:last], level[first - off : last - off], level[first + off : last + off]
        to = ridge[first:last]
        for i in range(last - first):
            flank = max(one[i], other[i])
            to[i] = max(own[i], flank) - flank
        if sign == 0:
            for i in range(last - first):
                flank = min(one[i], other[i])
                to[i] = max(to[i], np.uint8(max(own[i], flank) - own[i]))
        for r in range(room, room + height):
            ridge[r * stride : r * stride + room] = 0
            ridge[(r + 1) * stride - room : (r + 1) * stride] = 0
        for row in range(rows):
            at = (room + row * pool) * stride
            _highest(ridge, at, stride, pool, tall[row * stride : (row + 1) * stride])
        _highest(tall, pool, 1, pool, high[pool:-pool])
        for row in range(rows):
            at, to = row * stride + room, flat[(step * rows + row) * columns :]
            for column in range(columns):
                to[column] = high[at + column * pool]
    return flat


@kernel
def _highest(values: np.ndarray, first: int, stride: int, pool: int, highest: np.ndarray) -> None:
    """Of some of flat values, from the first on, each the highest of it and its neighbours `stride` apart, nearer than
    `pool` of them: into (N,)."""
    count = len(highest)
    own = values[first : first + count]
    for i in range(count):
        highest[i] = own[i]
    for k in range(1, pool):
        before = values[first - k * stride : first - k * stride + count]
        after = values[first + k * stride : first + k * stride + count]
        for i in range(count):
            highest[i] = max(highest[i], max(before[i], after[i]))


@kernel
def _scores(flat: np.ndarray, index: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(P,) of paths whose samples stand at `index` (P, S) in flat responses: their sum over `weight` (P,).

    A response is zero up to the texture's level and saturates at a few times that, where a ridge is clear: a brighter
    ridge must not make up for a detour.
    """
    few, counts, score = flat[:: 1 + len(flat) // 20_000], np.zeros(256, np.int64), np.empty(len(index))
    for one in few:
        counts[one] += 1
    ordinary, below = 1.0, counts[0]
    while below < _TEXTURE_QUANTILE * len(few):
        below += counts[int(ordinary)]
        ordinary += 1.0
    saturating = np.empty(256, np.int32)
    for level in range(256):
        over = max(level - ordinary, 0.0)
        saturating[level] = int(np.rint(250.0 * over / (over + 3.0 * ordinary)))
    for p in range(len(index)):
        total = 0
        for s in range(index.shape[1]):
            total += saturating[flat[index[p, s]]]
        score[p] = total / weight[p]
    return score


@kernel
def _clearest(score: np.ndarray, paths_px: np.ndarray, apart_px: float, count: int, share: float) -> list[int]:
    """Up to so many of the paths (P, S, 2), best first, that differ from the ones before them; their scores (P,) at
    least this share of the best. Two are alike where most of their points lie within `apart_px`."""
    best = int(score.argmax())
    found, left = [best], score >= share * score[best]
    for _ in range(1, count):
        other = -1
        for p in range(len(score)):
            if not left[p]:
                continue
            apart, several = 0, 0
            for s in range(0, paths_px.shape[1], 8):
                gap = max(abs(paths_px[p, s, 0] - paths_px[best, s, 0]), abs(paths_px[p, s, 1] - paths_px[best, s, 1]))
                apart, several = apart + (gap > apart_px), several + 1
            left[p] = apart >= _APART * several
            if left[p] and (other < 0 or score[p] > score[other]):
                other = p
        if other < 0:
            break
        best = other
        found.append(best)
    return found
