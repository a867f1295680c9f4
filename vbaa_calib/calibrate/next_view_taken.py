"""The pictures taken so far: what they tell of the lens, and what makes that doubtful."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from targets.board import BoardSpec
from targets.charuco import corner_points

from ..detect.corners import BoardView
from .board_flex import bend
from .corner_stack import Observation
from .intrinsics import MIN_CORNERS, LensSolution
from .lens_start import start_poses
from .next_view_worth import Design, design_about, nominal_intrinsics, view_blocks
from .view_screening import usable_views

_NOMINAL_SIGMA_PX = 0.2
_LEAST_SIGMA_PX = 0.02
_NOMINAL_MODEL = "radial"


@dataclass(frozen=True, eq=False)
class Taken:
    """What the pictures so far are worth.

    Attributes
    ----------
    design : the lens they are judged about. information : (p, p) of all of them, in its coordinates, without the prior.
    pull : (p,) by how much they ask for another lens of the design, in units of information.
    pictures : how many it rests on. solved : whether it is a solution or a nominal lens.
    inflation : by how much the pictures contradict each other more than their noise explains, at least 1.
    doubt : what forbids to call it enough, in words; empty where nothing does.
    """

    design: Design
    information: np.ndarray
    pull: np.ndarray
    pictures: int
    solved: bool
    inflation: float
    doubt: str


def with_a_lens(solution: LensSolution, views: Sequence[BoardView], spec: BoardSpec) -> Taken:
    """Of the views that a lens rests on, without their outliers."""
    camera, by_name = solution.camera, {view.name: view for view in views}
    intrinsics = camera.parameters
    points, rise, observations, poses = corner_points(spec), bend(spec), [], []
    for used in solution.views:
        view = by_name[used.name]
        good = ~np.isin(view.ids, used.outlier_ids)
        ids = view.ids[good]
        observations.append(Observation(points[ids], view.corners_px[good], rise[ids]))
        poses.append(used.T_camera_board.vector)
    sigma = _sigma_px(solution, sum(len(view.pixels) for view in observations))
    sagittas = solution.board_flex.sagittas_m if solution.board_flex.used else None
    design = design_about(solution.model, intrinsics, camera.image_size, sigma, spec, sagittas)
    blocks, pulls = view_blocks(design, np.array(poses), observations)
    chosen = next((row for row in solution.comparison if row.model == solution.model), None)
    disagree = chosen is not None and not chosen.halves_agree and chosen.halves is not None
    inflation = max(1.0, float(chosen.halves)) if disagree and chosen is not None and chosen.halves else 1.0
    doubt = "the lens folds inside the picture: pictures with the board near the border are missing"
    whole = blocks.sum(axis=0), pulls.sum(axis=0)
    return Taken(design, *whole, len(poses), True, inflation, "" if solution.monotonic else doubt)


def _sigma_px(solution: LensSolution, corners: int) -> float:
    """Per axis, from the residuals and what the solve could fit away."""
    free = 2 * corners - 6 * len(solution.views) - len(solution.camera.parameter_names)
    return max(_LEAST_SIGMA_PX, solution.rms_inliers_px * float(np.sqrt(corners / max(free, 1))))


def before_a_lens(views: Sequence[BoardView], spec: BoardSpec, image_size: tuple[int, int]) -> Taken:
    """Of views that are too few for a lens, under a nominal one."""
    intrinsics = nominal_intrinsics(image_size)
    design = design_about(_NOMINAL_MODEL, intrinsics, image_size, _NOMINAL_SIGMA_PX, spec)
    usable = usable_views(views, spec, MIN_CORNERS)[0] if views else []
    points = corner_points(spec)
    observations = [Observation(points[view.ids], view.corners_px) for view in usable]
    count = design.scale.shape[1]
    if not observations:
        return Taken(design, np.zeros((count, count)), np.zeros(count), 0, False, 1.0, "")
    blocks, pulls = view_blocks(design, start_poses(intrinsics, observations), observations)
    return Taken(design, blocks.sum(axis=0), pulls.sum(axis=0), len(usable), False, 1.0, "")
