"""What a set of views is lacking: parts of the picture that no corner reached, and ways to hold the board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from targets.board import BoardSpec

from ...detect.corners import BoardView
from ...diagnosis import Diagnosis
from ..intrinsics import LensSolution
from .same_pose import apart_px

COLUMNS, ROWS = 8, 6
FEWEST_VIEWS = 5
_TILTED_RAD = np.radians(15.0)
_LEAST_HULL = 0.5
_REPEATED = 0.5


@dataclass(frozen=True, eq=False)
class Coverage:
    """Where in the picture corners were seen.

    Attributes
    ----------
    counts : (ROWS, COLUMNS) corners in each cell of a grid over the picture.
    hull_share : share of the picture's area within the hull of all corners.
    """

    counts: np.ndarray
    hull_share: float

    @property
    def empty_corners(self) -> tuple[str, ...]:
        """The picture's corners, a quarter of its width by a third of its height, with no corner of the board."""
        wide, high = COLUMNS // 4, ROWS // 3
        parts = {
            "upper left": self.counts[:high, :wide],
            "upper right": self.counts[:high, -wide:],
            "lower left": self.counts[-high:, :wide],
            "lower right": self.counts[-high:, -wide:],
        }
        return tuple(name for name, part in parts.items() if not part.any())


def coverage(views: Sequence[BoardView]) -> Coverage:
    """Of views of one picture size, at least one."""
    width, height = views[0].image_size
    pixels = np.concatenate([view.corners_px for view in views])
    cells = np.clip((pixels + 0.5) / (width, height) * (COLUMNS, ROWS), 0, (COLUMNS - 1, ROWS - 1)).astype(int)
    counts = np.bincount(cells[:, 1] * COLUMNS + cells[:, 0], minlength=ROWS * COLUMNS).reshape(ROWS, COLUMNS)
    area = float(cv2.contourArea(cv2.convexHull(pixels.astype(np.float32)))) if len(pixels) > 2 else 0.0
    return Coverage(counts, area / (width * height))


def poorly_covered(views: Sequence[BoardView]) -> Diagnosis | None:
    """Whether the corners leave out much of the picture, and which of its corners."""
    seen = coverage(views)
    empty = seen.empty_corners
    if seen.hull_share >= _LEAST_HULL and len(empty) < 2:
        return None
    where = f", none in the {', '.join(empty)}" if empty else ""
    return Diagnosis(
        "border_empty",
        f"the corners reach over {100 * seen.hull_share:.0f} % of the picture{where}",
        f"show the board in the {empty[0] if empty else 'picture’s corners'}, also partly outside",
    )


def little_variety(views: Sequence[BoardView], solution: LensSolution, spec: BoardSpec) -> list[Diagnosis]:
    """Poses that repeat, boards that are never tilted, or always the same way."""
    found = [one for one in (_repeated(views, spec), _parallel(solution)) if one is not None]
    return found if len(solution.views) >= FEWEST_VIEWS else []


def _repeated(views: Sequence[BoardView], spec: BoardSpec) -> Diagnosis | None:
    kept: list[BoardView] = []
    for view in views:
        if all(apart_px(view, other, spec) is None for other in kept):
            kept.append(view)
    again = len(views) - len(kept)
    if again < _REPEATED * len(views):
        return None
    return Diagnosis(
        "same_poses",
        f"{len(views)} pictures show the board in {len(kept)} poses only",
        "one picture of each pose is enough: turn and move the board between them",
    )


def _parallel(solution: LensSolution) -> Diagnosis | None:
    """How far the board's directions spread: none of them all, or along one line only."""
    normals = np.array([view.T_camera_board.rotation[:, 2] for view in solution.views])
    _, _, axes = np.linalg.svd(normals)
    around = np.arctan2(normals @ axes[1:].T, np.abs(normals @ axes[:1].T))
    widest, other = (np.ptp(around, axis=0)).tolist()
    if max(widest, other) < _TILTED_RAD:
        return Diagnosis(
            "never_tilted",
            f"the board's directions differ by {np.degrees(max(widest, other)):.0f}° at most",
            "tilt it by 30° to 45° in several pictures, each time another edge towards the camera",
        )
    if min(widest, other) < _TILTED_RAD:
        wide, narrow = np.degrees([max(widest, other), min(widest, other)])
        return Diagnosis(
            "tilted_one_way",
            f"the board is tilted about one axis only: by {wide:.0f}°, about the other by {narrow:.0f}°",
            "tilt it also the other way: a neighbouring edge towards the camera",
        )
    return None
