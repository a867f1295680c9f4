"""Pictures of the free antenna over a board that lies on plane C: the folder over/ of a session."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..antenna.rod import Rod, solve_rod
from ..geometry import Pose
from .picture import LAMP_WORLD, Patch, Studio, digitise, expose, surroundings
from .render import HOLDER_PAINT
from .render_antenna import tube, tube_patch
from .render_board import Sheet, board_patch
from .scene import Joints, OverSpec, Scene, true_rod
from .write_files import write_picture


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
