"""The antenna in pictures of one rig: what can be worked out once is kept, what is left costs about a millisecond."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from vbaa_calib.core.errors import InputError

from .acceptance import OTHER_LINE_SEEN, best_of, reject_beside_clamp, reject_faint
from .centreline import Centreline
from .corridor import Corridor
from .path_refinement import RefinedPath, refine_path
from .profile import measure_on
from .templates import Templates, downsampled, ridge_responses, templates

OTHER_PATH_SHARE = 0.75
"""A second path is looked at when it scores this much of the best one's."""
BLURRED_PX = 8.0
"""Blur at which the antenna is looked for once more where it is not found in focus."""
CHANGING_PATHS, CHANGING_SHARE, CHANGING_OTHER = 4, 0.5, 0.85
"""The same where the polarity changes along the antenna: so many paths, of so much of the best one's score; and how
much of a second line, of what is seen of the first, makes the picture ambiguous."""
APART = 0.4
"""Fraction of their length over which two paths must differ to be two."""


@dataclass(frozen=True, eq=False)
class AntennaFinder:
    """Looks for the antenna in a corridor, in pictures of one size; make one per rig and use it for every frame.

    Attributes
    ----------
    corridor : where the antenna may be. image_size : (width, height).
    shapes : the paths it may take.
    factor, pool, reach : how far the picture is reduced, its response pooled, and where the flanks are looked at.
    index : (P, S) place of every sample in the flat response.
    weight : (P,) what a path's sum is divided by: how many of its samples are in the picture, but not too few.
    usual_height : of the antenna's line over its background in this rig's pictures, grey levels; 0 where not known.
    """

    corridor: Corridor
    image_size: tuple[int, int]
    shapes: Templates
    factor: int
    pool: int
    reach: int
    index: np.ndarray
    weight: np.ndarray
    usual_height: float = 0.0

    @staticmethod
    def prepare(corridor: Corridor, image_size: tuple[int, int]) -> AntennaFinder:
        """Table the paths of a corridor."""
        shapes = templates(corridor)
        factor = int(np.clip(corridor.width_px / 2.5, 2, 12))
        pool = int(np.clip(np.ceil(0.5 * shapes.spacing_px / factor), 1, 4))
        reach = max(2, int(np.ceil((0.5 * corridor.width_px + 1.5) / factor)))
        size = np.maximum(np.array(image_size) // factor, 1)
        rows, columns = -(-size[1] // pool), -(-size[0] // pool)
        at = np.rint(((shapes.paths_px + 0.5) / factor - 0.5) / pool)
        there: np.ndarray = np.all((at >= 0) & (at < [columns, rows]), axis=-1)
        at = np.where(there[..., None], at, 0.0).astype(np.int64)
        flat = (shapes.direction.astype(np.int64) * rows + at[..., 1]) * columns + at[..., 0]
        index = np.where(there, flat, 4 * rows * columns).astype(np.intp)
        weight = np.maximum(there.sum(axis=1), 0.3 * index.shape[1])
        return AntennaFinder(corridor, image_size, shapes, factor, pool, reach, index, weight)

    def with_usual_height(self, usual_height: float) -> AntennaFinder:
        """The same finder for a line of known height: the `amplitude` of the free antenna's pictures.

        A bar or edge that looks like an antenna mostly is fainter.
        """
        return replace(self, usual_height=usual_height)

    def candidates(self, image: np.ndarray, bright: bool | None = True, blurred_px: float = 0.0) -> list[np.ndarray]:
        """Paths (K, 2) that look like the antenna in an (H, W) picture, blurred by about so many pixels.

        The best one, and after it the best of those that differ from it and score nearly as well, if there is one;
        with `bright` None, which more things look like, up to `CHANGING_PATHS` that all differ.
        """
        small = downsampled(image, self.factor)
        reach = self.reach + int(np.ceil(0.6 * blurred_px / self.factor))
        flat = ridge_responses(small, reach, self.pool, bright)
        # "wrap" only spares take the check of an index that is known to be good
        total = cv2.reduce(flat.take(self.index, mode="wrap"), 1, cv2.REDUCE_SUM, dtype=cv2.CV_32S).ravel()
        score = total / self.weight
        best = int(score.argmax())
        paths = [self.shapes.paths_px[best]]
        count, share = (2, OTHER_PATH_SHARE) if bright is not None else (CHANGING_PATHS, CHANGING_SHARE)
        others = np.flatnonzero(score >= share * score[best])
        for _ in range(1, count):
            others = others[~self._alike(best, others)]
            if not len(others):
                break
            best = int(others[score[others].argmax()])
            paths.append(self.shapes.paths_px[best])
        return paths

    def find(self, image: np.ndarray, bright: bool | None = True) -> Centreline:
        """The centreline in a picture, with its verdict; where there is none in focus, one out of focus.

        image (H, W) uint8, uint16 or float; a colour picture goes through `paint.Paint`. bright : brighter than its
        surroundings, darker, or, with None, here this and there that. Raises InputError when it is
        not of the size that the finder was made for.
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
        reach = 1.2 * self.shapes.spacing_px + 0.5 * self.corridor.width_px + 4.0
        return refine_path(image, rough, self.corridor.width_px + blurred_px, reach, bright)

    def _look(self, image: np.ndarray, bright: bool | None, blurred_px: float) -> Centreline:
        width = self.corridor.width_px
        lines = []
        for rough in self.candidates(image, bright, blurred_px):
            path = self.path(image, rough, bright, blurred_px).path_px
            line = measure_on(image, path, width, bright, blurred_px)
            # a line that may be of either polarity has geometry alone to tell it from others
            lines.append(reject_beside_clamp(line, self.corridor) if bright is None else line)
        alike = OTHER_LINE_SEEN if bright is not None else CHANGING_OTHER
        return reject_faint(best_of(lines, width, alike), self.usual_height)

    def _alike(self, best: int, others: np.ndarray) -> np.ndarray:
        """(Q,) whether those paths are much the same as that one."""
        few = self.shapes.paths_px[others, ::8]
        gap = np.abs(few - self.shapes.paths_px[best, ::8]).max(axis=-1)
        apart = gap > 2.0 * self.shapes.spacing_px + self.corridor.width_px
        return apart.mean(axis=1) < APART


def trace(image: np.ndarray, corridor: Corridor, bright: bool | None = True) -> np.ndarray:
    """(K, 2) rough path of the antenna from clamp to tip, pixels. There is always one; `profile.measure` judges it.

    image (H, W). Hidden stretches are bridged by a smooth curve.
    """
    finder = AntennaFinder.prepare(corridor, (image.shape[1], image.shape[0]))
    return finder.path(image, finder.candidates(image, bright)[0], bright).path_px
