"""Which pictures of a sweep a pose may rest on, and what is wrong with the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from targets.board import BoardSpec

from ..camera import Camera
from ..detect.corners import BoardView
from ..errors import InputError
from ..geometry import Kinematics
from ..session import SweepPicture
from .sweep_model import SweepCorners, SweepState, linearise
from .sweep_solve import ALL_FREE, AXES_HELD, inlying, robust
from .sweep_start import turned_over
from .view_screening import DroppedView, usable_views

LEAST_PICTURES = 5
"""A cross: the middle, and either side of both joints. Three fix the pose, but of fewer than five nothing tells how far
the readings scatter: with four, and 0.3 mrad, 14 of 120 sweeps were off by over six of their standard deviations."""

_LEAST_TURN_RAD = 0.01
_GROSS_PICTURE = 5.0
_GROSS_LEAST_PX = 0.5
_GROSS_ANGLE = 5.0
_ROUNDS = 6
_FEW_PICTURES = 8
_NO_ENCODER_RAD = 5e-3  # joints at rest scatter less: such a misfit is one wrong row's
_AGREE = 0.1
_OWN_STEPS = 20
_OWN_STEP_RAD = 0.2
_OWN_FIT_PX = 5.0
_CROSS = "take a cross at least: the middle, pan to either side, tilt to either side, by 0.1 rad and more"
_MEND = "look the rows through; the board must not move, the joints be at rest, the angles in radians"


def usable_pictures(
    views: Sequence[BoardView], pictures: Sequence[SweepPicture], spec: BoardSpec, camera: Camera
) -> tuple[list[BoardView], list[SweepPicture], list[DroppedView]]:
    """Views that fix the board's pose, their readings, and the others with the reason.

    Raises InputError when too few are left, or a picture has another size than the lens was calibrated at.
    """
    for view in views:
        if view.image_size != tuple(camera.image_size):
            was, is_ = (f"{size[0]}x{size[1]} px" for size in (camera.image_size, view.image_size))
            raise InputError(
                f"is {is_}, the lens was calibrated at {was}",
                where=view.name,
                remedy="take all pictures at one resolution",
            )
    usable, dropped = usable_views(views, spec, 0)
    places = [next(i for i, view in enumerate(views) if view is one) for one in usable]
    if len(usable) < LEAST_PICTURES:
        raise InputError(
            f"{len(usable)} pictures of the sweep show the board, at least {LEAST_PICTURES} are needed", remedy=_CROSS
        )
    return usable, [pictures[place] for place in places], dropped


def refuse_one_joint(readings: Sequence[SweepPicture]) -> None:
    """Raises InputError unless both joints moved in the pictures that can be used."""
    spans = {
        "pan": np.ptp([reading.pan_rad for reading in readings]),
        "tilt": np.ptp([reading.tilt_rad for reading in readings]),
    }
    still = [name for name, span in spans.items() if span < _LEAST_TURN_RAD]
    if len(still) == 2:
        raise InputError("neither joint moved in the pictures of the sweep", remedy=_CROSS)
    if still:
        moved = "tilt" if still == ["pan"] else "pan"
        raise InputError(
            f"only the {moved} moved in the sweep: the camera's turn about the {moved} axis and its place along it "
            "stay open",
            remedy=f"add pictures with the {still[0]} turned by 0.1 rad and more",
        )


def which_pictures(
    camera: Camera, state: SweepState, corners: SweepCorners
) -> tuple[SweepState, np.ndarray, np.ndarray]:
    """A robust state, which pictures it explains (P,) bool, and by how much it misses each (P,) px.

    A picture is taken back where its angles are no further off than those of the others scatter.

    Raises InputError when the angles belong to hardly more than half of the pictures, or one row is wrong and nothing
    tells which.
    """
    state = _settled(camera, state, corners)
    kept = np.ones(corners.pictures, bool)
    for _ in range(_ROUNDS):
        state, residuals = robust(camera, state, corners, kept[corners.picture], ALL_FREE)
        error = _missed_px(residuals, corners)
        before, kept = kept, error <= max(_GROSS_PICTURE * float(np.median(error[kept])), _GROSS_LEAST_PX)
        if np.array_equal(kept, before):
            break
    kept = _taken_back(camera, state, corners, kept)
    if LEAST_PICTURES <= kept.sum() <= _FEW_PICTURES:
        state, kept = _without_the_odd_one(camera, state, corners, kept)
    if kept.sum() < max(LEAST_PICTURES, 0.6 * corners.pictures):
        what = f"the angles of sweep.csv explain {kept.sum()} of {corners.pictures} pictures, too few"
        raise InputError(what, remedy=_MEND)
    return state, kept, _missed_px(linearise(camera, state, corners).residuals_px, corners)


def _settled(camera: Camera, state: SweepState, corners: SweepCorners) -> SweepState:
    """A robust state from a start, whichever way the board leans; with the axes where they are given."""
    every = np.ones(len(corners.pixels), bool)
    first = robust(camera, state, corners, every, AXES_HELD)
    other = robust(camera, turned_over(first[0], corners), corners, every, AXES_HELD)
    return min((first, other), key=lambda one: float(np.linalg.norm(one[1], axis=1).sum()))[0]


def _missed_px(residuals: np.ndarray, corners: SweepCorners) -> np.ndarray:
    distance = np.linalg.norm(residuals, axis=1)
    return np.array([np.median(distance[corners.picture == index]) for index in range(corners.pictures)])


def _taken_back(camera: Camera, state: SweepState, corners: SweepCorners, kept: np.ndarray) -> np.ndarray:
    readings = np.stack([corners.pan_rad, corners.tilt_rad], axis=1)
    for _ in range(_ROUNDS):
        if kept.all():
            break
        found, _ = inlying(camera, state, corners, kept[corners.picture], ALL_FREE)
        back = kept.copy()
        for index in np.flatnonzero(~kept):
            angles = _own_angles(camera, found.state, corners, int(index))
            if angles is not None:
                back[index] = np.abs(angles - readings[index]).max() <= _GROSS_ANGLE * found.angle_std_rad
        if np.array_equal(back, kept):
            break
        state, kept = found.state, back
    return kept


def _without_the_odd_one(
    camera: Camera, state: SweepState, corners: SweepCorners, kept: np.ndarray
) -> tuple[SweepState, np.ndarray]:
    """Leaves out the picture without which the angles of the others agree.

    Among few pictures one wrong row bends the fit so far that all seem a little off.
    """
    whole, _ = inlying(camera, state, corners, kept[corners.picture], ALL_FREE)
    if whole.angle_std_rad < _NO_ENCODER_RAD:
        return whole.state, kept
    places = np.arange(corners.pictures)
    others = [kept & (places != index) for index in np.flatnonzero(kept)]
    fits = [inlying(camera, state, corners, some[corners.picture], ALL_FREE)[0] for some in others]
    agree = [i for i, found in enumerate(fits) if found.angle_std_rad < _AGREE * whole.angle_std_rad]
    if len(agree) > 1:
        raise InputError(
            f"one row of sweep.csv is off by {whole.angle_std_rad:.2g} rad or more, and nothing tells which",
            remedy="look them through, or take a few pictures more",
        )
    return (fits[agree[0]].state, others[agree[0]]) if agree else (whole.state, kept)


def _own_angles(camera: Camera, state: SweepState, corners: SweepCorners, picture: int) -> np.ndarray | None:
    """(2,) pan and tilt at which one picture's corners would fit a state best; None where no angles near by do."""
    mine = corners.picture == picture
    angles = np.array([corners.pan_rad[picture], corners.tilt_rad[picture]])
    for _ in range(_OWN_STEPS):
        alone = SweepCorners(
            corners.points_m[mine], corners.pixels[mine], np.zeros(int(mine.sum()), int), angles[:1], angles[1:]
        )
        moved = linearise(camera, state, alone)
        design, left = moved.by_angles.reshape(-1, 2), moved.residuals_px.ravel()
        angles = angles + np.clip(np.linalg.lstsq(design, left, rcond=None)[0], -_OWN_STEP_RAD, _OWN_STEP_RAD)
    error = float(np.median(np.linalg.norm(moved.residuals_px, axis=1)))
    return angles if error < _OWN_FIT_PX else None


def left_out_reason(
    camera: Camera, state: SweepState, corners: SweepCorners, index: int, error_px: float, kinematics: Kinematics
) -> str:
    """Why a picture was left out, with the angles at which it would fit."""
    what = f"its corners lie {error_px:.1f} px from where its angles put them"
    angles = _own_angles(camera, state, corners, index)
    if angles is None:
        return f"{what}; did the board or the camera move?"
    pan, tilt = angles[0], angles[1] - kinematics.tilt_zero_rad
    row_tilt = corners.tilt_rad[index] - kinematics.tilt_zero_rad
    return (
        f"{what}: it looks like pan {pan:.3f}, tilt {tilt:.3f}, its row says {corners.pan_rad[index]:.3f}, "
        f"{row_tilt:.3f}"
    )
