"""A sweep of a simulated rig: a board that stays in the world, seen while pan and tilt carry the camera past it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry import Pose
from .lens import project
from .picture import Studio
from .plan import BoardShot, stream
from .render import render_shot
from .render_board import Sheet, outline
from .scene import Joints, Scene
from .write_files import write_picture, write_rows

_FULL = ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
_HALF = ((1, 1), (-1, -1), (1, -1), (-1, 1))
_PAN_RAD, _TILT_RAD = 0.5, 0.4
_SHRINK, _LEAST = 0.9, 0.1
_LEAN_RAD = (0.35, -0.25)
_SHARES = (0.6, 0.5, 0.4, 0.32, 0.25)
_STREAM = 1_000_000  # the sweep's pictures take their noise after all those of the plan


def write_sweep(scene: Scene, place: Studio, sheet: Sheet, root: Path) -> Pose:
    """Write sweep/*.png and sweep/sweep.csv into a session's folder.

    The board is put and the joints are turned so that the whole sheet stays in the picture.

    Returns
    -------
    Pose : T_world_board of the printed face, what is true of the sweep.

    Raises
    ------
    InputError : the camera sees no place where the board could stay in view.
    """
    T_world_board, joints = plan_sweep(scene, sheet)
    folder = root / "sweep"
    folder.mkdir()
    rows: list[dict[str, Any]] = []
    for index, at in enumerate(joints):
        name = f"sweep_{index:03d}.png"
        shot = BoardShot(f"sweep/{name}", at, _T_camera_board(scene, at, T_world_board))
        picture = render_shot(scene, place, sheet, shot, stream(scene, "pictures", _STREAM + index))
        write_picture(folder / name, picture)
        rows.append({"image": name, "pan_rad": at.pan_rad, "tilt_rad": at.tilt_rad})
    write_rows(folder / "sweep.csv", rows)
    return T_world_board


def plan_sweep(scene: Scene, sheet: Sheet) -> tuple[Pose, list[Joints]]:
    """The board's pose in the world and the joint angles: the widest sweep with the board as large as that allows.

    Raises InputError when the board does not stay in view however it is put.
    """
    best: tuple[float, Pose, list[Joints]] | None = None
    for share in _SHARES:
        T_world_board = _in_front(scene, share)
        reach = _reach(scene, sheet, T_world_board)
        # both a wide sweep and a large board tell more
        if reach is not None and (best is None or reach * share > best[0]):
            best = reach * share, T_world_board, _pattern(reach)
    if best is None:
        raise InputError(
            "the board does not stay in view while the joints move",
            where=f"scene {scene.name}",
            remedy="take a shorter lens or a smaller board",
        )
    return best[1], best[2]


def _pattern(reach: float) -> list[Joints]:
    moves = [(1.0 * pan, 1.0 * tilt) for pan, tilt in _FULL] + [(0.5 * pan, 0.5 * tilt) for pan, tilt in _HALF]
    return [Joints(round(reach * _PAN_RAD * pan, 6), round(reach * _TILT_RAD * tilt, 6)) for pan, tilt in moves]


def _in_front(scene: Scene, share: float) -> Pose:
    """T_world_board of a leaning board in the middle of the picture with the joints at zero, filling a share of it."""
    size = scene.board.square_m * np.array([scene.board.squares_x, scene.board.squares_y])
    focal = np.diag(scene.lens.matrix)[:2]
    distance = float((focal * size / (share * np.array(scene.lens.image_size))).max())
    turn = Pose.from_rotvec(np.array([*_LEAN_RAD, 0.0]), np.zeros(3)).rotation
    T_camera_board = Pose(turn, np.array([0.0, 0.0, distance]) - turn @ np.append(size / 2, 0.0))
    return scene.T_world_antenna(Joints(0.0, 0.0)) @ scene.T_antenna_camera @ T_camera_board


def _reach(scene: Scene, sheet: Sheet, T_world_board: Pose) -> float | None:
    """The largest share of the full sweep at which the sheet stays in every picture."""
    reach = 1.0
    while reach >= _LEAST:
        if _all_in_view(scene, sheet, T_world_board, _pattern(reach)):
            return reach
        reach *= _SHRINK
    return None


def _all_in_view(scene: Scene, sheet: Sheet, T_world_board: Pose, joints: Sequence[Joints]) -> bool:
    last = np.array(scene.lens.image_size) - 1
    for at in joints:
        T_camera_board = _T_camera_board(scene, at, T_world_board)
        pixels = project(scene.lens, T_camera_board @ outline(sheet))
        faces = T_camera_board.rotation[:, 2] @ T_camera_board.translation_m > 0
        if not (faces and np.isfinite(pixels).all() and (pixels >= 0).all() and (pixels <= last).all()):
            return False
    return True


def _T_camera_board(scene: Scene, joints: Joints, T_world_board: Pose) -> Pose:
    return (scene.T_world_antenna(joints) @ scene.T_antenna_camera).inverse() @ T_world_board
