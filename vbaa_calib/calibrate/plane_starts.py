"""Where the pose of a plane may be: closed forms, and the mirror image that a plane allows."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from ..errors import SolveError
from ..geometry import Pose

_SAME_START_RAD = 0.02


def start_poses(points: np.ndarray, normalized: np.ndarray) -> list[Pose]:
    """Poses by every closed form at hand: IPPE alone can be far off or NaN, and says nothing of it.

    points : (N, 3) m, all with z = 0. normalized : (N, 2) their rays' x/z and y/z. Raises SolveError without one.
    """
    starts: list[Pose] = []
    for method in (cv2.SOLVEPNP_ITERATIVE, cv2.SOLVEPNP_SQPNP, cv2.SOLVEPNP_IPPE):
        try:
            _, rotvecs, translations, _ = cv2.solvePnPGeneric(points, normalized, np.eye(3), None, flags=method)
        except cv2.error:
            continue
        for rotvec, translation in zip(rotvecs, translations, strict=True):
            if np.all(np.isfinite(rotvec)) and np.all(np.isfinite(translation)) and translation[2] > 0.0:
                start = Pose.from_rotvec(rotvec.ravel(), translation)
                if all(turn_between(start, other) > _SAME_START_RAD for other in starts):
                    starts.append(start)
    if not starts:
        raise SolveError("no pose of the board explains its corners: is the lens that of this camera?")
    return starts


def turn_between(one: Pose, other: Pose) -> float:
    """Angle between two orientations, rad."""
    return float(Rotation.from_matrix(one.rotation @ other.rotation.T).magnitude())


def mirrored(T_camera_board: Pose, points: np.ndarray) -> Pose:
    """Pose of the board, points (N, 3) m, turned about its centre its normal to the other side of the line of sight."""
    centre_board = points.mean(axis=0)
    centre = T_camera_board @ centre_board
    sight, normal = centre / np.linalg.norm(centre), T_camera_board.rotation[:, 2]
    axis = np.cross(normal, sight)
    angle = 2.0 * np.arctan2(np.linalg.norm(axis), normal @ sight)
    turn = Rotation.from_rotvec(angle * axis / max(float(np.linalg.norm(axis)), 1e-12)).as_matrix()
    rotation = turn @ T_camera_board.rotation
    return Pose(rotation, centre - rotation @ centre_board)
