"""The antenna in pictures of one rig: its possible paths are tabulated once, a search takes about a millisecond."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from vbaa_calib.antenna.taper import UNIFORM, Taper
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.polyline import arc_lengths, followed, normals, resample
from vbaa_calib.native import core

from .acceptance import best_of, of_antennas_shape, reject_faint
from .centreline import Centreline, too_short
from .corridor import Corridor, free_curve
from .profile import measure, measure_on, measure_ribbon, refine_path
from .settings import ProfileSettings, SearchSettings

SAMPLES = 72
"""Samples along a template."""
LEAST_AXIS = 4
"""Fewest points of the free antenna that the lens must show."""


@dataclass(frozen=True, eq=False)
class AntennaFinder:
    """Detects the antenna within a corridor, in pictures of one size; prepared once per rig.

    Attributes
    ----------
    corridor : where the antenna may be. image_size : (width, height).
    paths_px : (P, S, 2) its possible paths, from clamp to tip. spacing_px : distance of neighbouring paths' tips.
    factor, pool, reach : how far the picture is reduced, its response pooled, and where the flanks are sampled.
    index, spans : (P, S) place of every sample in the flat response, and (R, 2) the columns of its rows that have any.
    weight : (P,) divisor of a path's sum: the number of its samples in the picture, with a lower bound.
    usual_height : of the antenna's line over its background in this rig's pictures, grey levels; 0 where not known.
    looks : (8, 4) its mean colour from clamp to tip and the standard deviation of that, grey levels; (0, 4) where not
        known.
    settings : of the search for shapes.
    """

    corridor: Corridor
    image_size: tuple[int, int]
    paths_px: np.ndarray
    spacing_px: float
    factor: int
    pool: int
    reach: int
    index: np.ndarray
    spans: np.ndarray
    weight: np.ndarray
    usual_height: float = 0.0
    looks: np.ndarray = field(default_factory=lambda: np.empty((0, 4)))
    settings: SearchSettings = field(default_factory=SearchSettings)

    @staticmethod
    def prepare(corridor: Corridor, image_size: tuple[int, int]) -> AntennaFinder:
        """The detector with the tabulated paths of a corridor."""
        paths, spacing = _templates(corridor)
        factor = int(np.clip(corridor.width_px / 2.5, 2, 12))
        pool = int(np.clip(np.ceil(0.5 * spacing / factor), 1, 4))
        reach = max(2, int(np.ceil((0.5 * corridor.width_px + 1.5) / factor)))
        tables = core.search.places(paths, factor, pool, reach, image_size)
        return AntennaFinder(corridor, image_size, paths, spacing, factor, pool, reach, *tables)

    def with_usual_height(self, usual_height: float) -> AntennaFinder:
        """The detector for a line of known height: the `amplitude` of the free antenna's pictures.

        Bars and edges that resemble an antenna are mostly fainter.
        """
        return replace(self, usual_height=usual_height)

    def candidates(self, image: np.ndarray, bright: bool = True, blurred_px: float = 0.0) -> list[np.ndarray]:
        """Paths (K, 2) that look like the antenna in an (H, W) picture blurred by about `blurred_px`; best first: up
        to two that differ and score alike."""
        score = self._scores(image, bright, blurred_px)
        return list(self.paths_px[self._clearest(score, 2, SearchSettings.other_path)])

    def _clearest(self, score: np.ndarray, most: int, share: float) -> list[int]:
        apart_px = 2.0 * self.spacing_px + self.corridor.width_px
        found: list[int] = core.search.clearest_paths(score, self.paths_px, apart_px, most, share)
        return found

    def find(self, image: np.ndarray, bright: bool | None = True, picture: np.ndarray | None = None) -> Centreline:
        """The centreline in a picture, with its verdict: a line of one polarity in focus, else out of focus.

        image : (H, W) uint8, uint16 or float; colour pictures go through `paint.Paint`. bright : whether the antenna is
        brighter than its surroundings; None: in part. picture : (H, W[, 3]) the same as it was taken, for its colours.
        Raises InputError for a picture of another size.
        """
        if image.shape != (self.image_size[1], self.image_size[0]):
            seen, meant = ("x".join(map(str, size)) for size in (image.shape[::-1], self.image_size))
            raise InputError(
                f"the picture is {seen}, the finder was made for {meant}",
                remedy="use the size of the calibration",
            )
        image = _finite(image)
        if bright is None:
            return self._likely(image, image if picture is None else _finite(picture))
        line = self._look(image, bright, 0.0)
        if line.found or line.verdict == "ambiguous":
            return line
        blurred = self._look(image, bright, SearchSettings.blurred_px)
        return blurred if blurred.found and blurred.seen > line.seen else line

    def path(self, image: np.ndarray, rough: np.ndarray, bright: bool = True, blurred_px: float = 0.0) -> np.ndarray:
        """A rough path (K, 2) moved onto the antenna and, in focus, extended along it as far as it continues."""
        reach = 1.2 * self.spacing_px + 0.5 * self.corridor.width_px + 4.0
        path = refine_path(image, rough, self.corridor.width_px + blurred_px, reach, bright)
        if blurred_px or too_short(path):
            return path
        longer: np.ndarray = core.profile.to_its_end(image, path, *self._in_focus, 1 if bright else -1)
        return longer

    @cached_property
    def _in_focus(self) -> tuple[int, object]:
        """Half length, px, of a profile across the antenna in focus, and its cross-section."""
        half = int(np.ceil(0.8 * self.corridor.width_px + 5.0))
        return half, core.profile.expected(self.corridor.width_px, ProfileSettings.blur_px, half + 2)

    def along(
        self,
        image: np.ndarray,
        guide_px: np.ndarray,
        width_px: float,
        bright: bool | None,
        picture: np.ndarray | None = None,
        odds: float = np.nan,
    ) -> Centreline:
        """The line measured near a guide (K, 2), from which an antenna of this width is at most about a width away.

        odds : of the line that led there.
        """
        guide_px = followed(guide_px, self.image_size)
        if bright is not None or too_short(guide_px):
            return measure(image, guide_px, width_px, bright, self.corridor.taper)
        where = replace(self.corridor, width_px=width_px)
        return replace(self, corridor=where)._along_shape(image, image if picture is None else picture, guide_px, odds)

    def rough(self, picture: np.ndarray) -> np.ndarray:
        """(R, K, 2) distinct paths along which a picture (H, W[, 3]) is brighter or darker than on both sides."""
        score = self._scores(picture, None)
        return self.paths_px[self._clearest(score - score.min(), self.settings.shapes, self.settings.share)]

    def shapes(self, picture: np.ndarray) -> list[tuple[np.ndarray, float]]:
        """Possible shapes (S, 2) of the antenna along which a picture (H, W[, 3]) has two edges, and their mean log
        odds per correlation length, the likeliest first; without those that hardly differ from an earlier one."""
        where, settings = self.corridor, self.settings
        calibrated = where.shape_px is not None
        axis, _ = _sampled_axis(where)
        found = core.search.likely_shapes(
            np.ascontiguousarray(picture),
            axis,
            self.rough(picture),
            self.spacing_px,
            where.width_px,
            np.array(settings.contacts if calibrated else settings.few_contacts),
            (settings.calibrated_clamp_px if calibrated else where.clamp_px, where.clamp_rad),
            self.looks,
            settings,
        )
        lengths = float(arc_lengths(axis)[-1]) / settings.correlation_px
        kept: list[tuple[np.ndarray, float]] = []
        for odds, _, path, _ in found:
            enough = not kept or odds > settings.share * found[0][0]
            alike = (np.abs(path - each).max(axis=1).mean() < where.width_px for each, _ in kept)
            if enough and len(kept) < settings.shapes and not any(alike):
                kept.append((path, odds / lengths))
        return kept

    def _scores(self, picture: np.ndarray, bright: bool | None, blurred_px: float = 0.0) -> np.ndarray:
        """(P,) scores of the paths: how much brighter or darker (None: either) they are than both of their sides, at
        each place in the channel of a picture (H, W[, C]) that has most contrast there. blurred_px : the picture's
        blur, roughly."""
        reach = self.reach + int(np.ceil(0.6 * blurred_px / self.factor))
        tables = (self.index, self.spans, self.weight, self.factor, self.pool, reach)
        found: np.ndarray = core.search.path_scores(
            np.ascontiguousarray(picture), *tables, bright is not False, not bright
        )
        return found

    def _likely(self, image: np.ndarray, picture: np.ndarray) -> Centreline:
        """The line along one of the likely shapes, even if it is brighter than its background here and darker there."""
        lines = [self._along_shape(image, picture, path, odds) for path, odds in self.shapes(picture)]
        return reject_faint(best_of(lines, self.corridor.width_px), self.usual_height)

    def _along_shape(
        self, image: np.ndarray, picture: np.ndarray, path_px: np.ndarray, odds: float = np.nan
    ) -> Centreline:
        """The line measured along a shape (K, 2), K ≥ 2, with these log odds, in the picture's colours if it has
        any, and judged by its shape."""
        path, _ = resample(path_px, 1.0)
        line = measure_ribbon(picture if coloured(picture) else image, path, self.corridor.width_px)
        return of_antennas_shape(replace(line, odds=odds), self.corridor, True)

    def _look(self, image: np.ndarray, bright: bool, blurred_px: float) -> Centreline:
        width, lines = self.corridor.width_px, []
        for rough in self.candidates(image, bright, blurred_px):
            path = self.path(image, rough, bright, blurred_px)
            line = measure_on(image, path, width, bright, blurred_px, self.corridor.taper)
            lines.append(of_antennas_shape(line, self.corridor, False))
        return reject_faint(best_of(lines, width), self.usual_height)


def finder(where: Corridor, camera: Camera, alike: AntennaFinder | None = None) -> AntennaFinder | None:
    """The antenna's detector in a corridor of this camera's pictures; None where too little of it is in view.

    alike : the finder of a similar corridor, to take its paths.
    """
    if not _shows(where):
        return None
    return AntennaFinder.prepare(where, camera.image_size) if alike is None else replace(alike, corridor=where)


def _shows(where: Corridor) -> bool:
    return len(where.axis_px) >= LEAST_AXIS and bool(arc_lengths(where.axis_px)[-1] >= SearchSettings.least_length_px)


def same_paths_m_s2(where: Corridor, parameters: np.ndarray, length_m: float, taper: Taper = UNIFORM) -> float:
    """Resolution of gravity within which the same search paths are used: it moves the free antenna's tip by half the
    distance between two paths. Tabulating these takes ten times as long as everything else."""
    if not _shows(where):
        return 0.0
    _, spacing_px = _sampled_axis(where)
    pulls = np.array([[0.0, 0.0, 0.0], [0.0, 10.0, 0.0]])
    tips = [free_curve(parameters, length_m, pull, taper).points_m[0, -1] for pull in pulls]
    sag_px = float(np.linalg.norm(tips[1] - tips[0])) / length_m * arc_lengths(where.axis_px)[-1]
    return 10.0 * float(min(0.5 * spacing_px / max(sag_px, 1e-9), 1.0))


def coloured(image: np.ndarray) -> bool:
    """Whether a picture (H, W[, 3]) has colours: a grey camera's may have three channels, too."""
    return image.ndim == 3 and bool(np.ptp(image[::8, ::8, :3], axis=2).any())


def _finite(image: np.ndarray) -> np.ndarray:
    """A picture of whole numbers unchanged, others as float32 with NaN and infinity replaced."""
    if image.dtype in (np.uint8, np.uint16):
        return image
    return np.nan_to_num(image.astype(np.float32), nan=0.0, posinf=0.0, neginf=0.0)


def _sampled_axis(corridor: Corridor) -> tuple[np.ndarray, float]:
    """A corridor's axis (S, 2) in equal steps, and the distance of neighbouring paths' tips, px."""
    axis, _ = resample(corridor.axis_px, max(arc_lengths(corridor.axis_px)[-1] / SAMPLES, 1e-3))
    return axis, max(0.9 * float(arc_lengths(axis)[-1]) / (len(axis) - 1), 3.0)


def _templates(corridor: Corridor) -> tuple[np.ndarray, float]:
    """Paths (P, S, 2) that fill a corridor so densely that the antenna is within the spacing, px, of one."""
    axis, spacing = _sampled_axis(corridor)
    length = arc_lengths(axis)[-1]
    step = length / (len(axis) - 1)
    tangent = np.gradient(axis, axis=0)
    heading = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    share = np.linspace(0.0, 1.0, len(axis))
    bent = []
    for contact in SearchSettings.few_contacts:
        reach = share / contact
        shape = np.where(reach < 1.0, reach * (2.0 - reach), 1.0)
        shape /= shape[-1]
        turn = np.arange(0.0, SearchSettings.largest_turn_rad, spacing / (length * shape.mean()))
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
    """(P,) mask of the paths with their tips within the corridor's reach of the axis's tip."""
    tip = corridor.axis_px[-1]
    across = normals(corridor.axis_px)[-1]
    along = np.array([across[1], -across[0]])
    offset = paths[:, -1] - tip
    return np.abs(offset @ across) <= corridor.reach_px[-1] + np.maximum(0.0, offset @ along)
