"""A sweep of a simulated rig: a board that stays in the world, seen while pan and tilt carry the camera past it."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from vbaa_calib.antenna.rod import Rod, solve_rod
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.plan.plan import BoardShot, stream
from vbaa_calib.simulate.render.antenna import tube, tube_patch
from vbaa_calib.simulate.render.board import Sheet, board_patch, outline
from vbaa_calib.simulate.render.picture import LAMP_WORLD, Patch, Studio, digitise, expose, surroundings
from vbaa_calib.simulate.render.render import HOLDER_PAINT, render_shot
from vbaa_calib.simulate.scene.lens import project
from vbaa_calib.simulate.scene.scene import Joints, OverSpec, Scene, true_rod

_PNG = (cv2.IMWRITE_PNG_COMPRESSION, 2)
"""Quick rather than small: a session has hundreds of pictures."""


def write_picture(path: Path, picture: np.ndarray) -> None:
    """A picture (H, W) uint8 as PNG."""
    path.write_bytes(cv2.imencode(".png", picture, _PNG)[1].tobytes())


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """At least one row as CSV; the columns are the first one's keys."""
    with path.open("w", encoding="utf-8", newline="") as table:
        writer = csv.DictWriter(table, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


@dataclass(frozen=True, eq=False)
class Wire:
    """A curve in the antenna frame with the radius and the paint of the tube around it."""

    arclength_m: np.ndarray
    points_m: np.ndarray
    radius_m: float
    paint: float


def over_wires(scene: Scene, joints: Joints) -> list[Wire]:
    """The free antenna at these joint angles, and its holder where the scene has one."""
    rod: Rod = true_rod(scene)
    gravity = scene.T_world_antenna(joints).rotation.T @ scene.gravity_world_m_s2
    shape = solve_rod(rod, gravity[None], np.array([rod.length_m]), np.zeros((1, 3)))
    wires = [Wire(shape.arclength_m[0], shape.points_m[0], scene.radius_m, scene.picture.antenna)]
    radius, length = scene.true.holder_m
    if radius > 0 and length > 0:
        s = np.linspace(-length, 0.0, 8)
        points = scene.true.clamp_offset_m + s[:, None] * np.array([1.0, 0.0, 0.0])
        wires.append(Wire(s, points, float(radius), HOLDER_PAINT))
    return wires


def render_over(
    scene: Scene, place: Studio, sheet: Sheet, over: OverSpec, wires: list[Wire], rng: np.random.Generator
) -> np.ndarray:
    """(height, width) uint8, the picture as the camera delivers it."""
    T_world_camera = scene.T_world_antenna(over.joints) @ scene.T_antenna_camera
    T_camera_antenna = scene.T_antenna_camera.inverse()
    T_antenna_board = over.T_antenna_board(sheet.spec)
    canvas = surroundings(place, T_world_camera.rotation)
    lamp_camera = T_world_camera.rotation.T @ LAMP_WORLD
    board = board_patch(place, sheet, T_camera_antenna @ T_antenna_board, T_world_camera.rotation)
    if board is not None and over.shadow > 0:
        board = _shaded(place, board, T_camera_antenna, over, wires[0], scene.T_antenna_camera.rotation @ lamp_camera)
    patches = [] if board is None else [board]
    for wire in wires:
        seen = tube(scene.lens, wire.arclength_m, T_camera_antenna @ wire.points_m, wire.radius_m, lamp_camera)
        patch = tube_patch(place, seen, wire.paint, scene.picture.shading_asymmetry)
        if patch is not None:
            patches.append(patch if board is None else _in_front(canvas, patch, board))
    return digitise(place.spec, expose(place, canvas, patches), rng)


def write_over(
    scene: Scene, place: Studio, sheet: Sheet, over: OverSpec, root: Path, rng: np.random.Generator
) -> dict[str, Any]:
    """Write over/over_000.png … below `root`, and return what truth.json should hold of them."""
    folder = root / "over"
    folder.mkdir()
    wires = over_wires(scene, over.joints)
    for index in range(over.pictures):
        picture = render_over(scene, place, sheet, over, wires, rng)
        write_picture(folder / f"over_{index:03d}.png", picture)
    return {
        "T_antenna_board": over.T_antenna_board(sheet.spec).to_dict(),
        "height_m": over.height_m,
        "tip_antenna_m": wires[0].points_m[-1].tolist(),
    }


def _region(patch: Patch) -> tuple[slice, slice]:
    rows, columns = (length // patch.factor for length in patch.alpha.shape)
    return slice(patch.top, patch.top + rows), slice(patch.left, patch.left + columns)


def _laid_over(canvas: np.ndarray, board: Patch, patch: Patch) -> np.ndarray:
    """What is behind a patch, in its sub-pixels: the canvas with the board on it."""
    alpha, brightness = (_resampled(values, board, patch) for values in (board.alpha, board.brightness))
    bare = cv2.resize(canvas[_region(patch)], patch.alpha.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return bare * (1.0 - alpha) + brightness


def _resampled(values: np.ndarray, own: Patch, other: Patch) -> np.ndarray:
    """Values in the sub-pixels of one patch in those of another; zero where the first does not reach."""
    scale = own.factor / other.factor
    shift = (np.array([other.left - own.left, other.top - own.top])) * own.factor + 0.5 * scale - 0.5
    inner = np.array([[scale, 0.0, shift[0]], [0.0, scale, shift[1]]])
    return cv2.warpAffine(values, inner, other.alpha.shape[::-1], flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)


def _in_front(canvas: np.ndarray, patch: Patch, board: Patch) -> Patch:
    """A patch that `expose` may lay over the canvas beside the board's, and that looks as if it hid the board.

    `expose` adds what each patch changes of the canvas alone; the difference between the board and the canvas behind
    the patch is put into its brightness.
    """
    bare = cv2.resize(canvas[_region(patch)], patch.alpha.shape[::-1], interpolation=cv2.INTER_LINEAR)
    lacking = patch.alpha * (bare - _laid_over(canvas, board, patch))
    return replace(patch, brightness=(patch.brightness + lacking).astype(np.float32))


def _shaded(
    place: Studio, board: Patch, T_camera_antenna: Pose, over: OverSpec, wire: Wire, lamp_antenna: np.ndarray
) -> Patch:
    """The board with the wire's soft shadow on it."""
    fall = (wire.points_m[:, 2] + over.height_m) / max(float(lamp_antenna[2]), 0.2)
    shadow = T_camera_antenna @ (wire.points_m - fall[:, None] * lamp_antenna)
    lens = place.rays.lens
    cast = tube_patch(place, tube(lens, wire.arclength_m, shadow, wire.radius_m, lamp_antenna), 1.0)
    if cast is None:
        return board
    cover = _resampled(cast.alpha, cast, board)
    soft = over.penumbra_m * float(np.diag(lens.matrix)[:2].mean()) / float(shadow[len(shadow) // 2, 2]) * board.factor
    dimmed = 1.0 - over.shadow * np.minimum(cv2.GaussianBlur(cover, (0, 0), max(soft, 0.5)), 1.0)
    return replace(board, brightness=(board.brightness * dimmed).astype(np.float32))


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
        T_world_board = _sweep_in_front(scene, share)
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


def _sweep_in_front(scene: Scene, share: float) -> Pose:
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
