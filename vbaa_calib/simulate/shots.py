"""One picture, from back to front: background, board or object, antenna, its holder."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import cv2
import numpy as np

from vbaa_calib.antenna.rod import solve_rod
from vbaa_calib.geometry import Pose
from vbaa_calib.native import core
from vbaa_calib.simulate.plan import AntennaShot, BoardShot
from vbaa_calib.simulate.render.antenna import DepthOfObstacle, Tube, tube, tube_patches
from vbaa_calib.simulate.render.board import Sheet, board_patches
from vbaa_calib.simulate.render.object import object_patch, obstacle, pressed_in
from vbaa_calib.simulate.render.picture import LAMP_WORLD, ImagePatch, Studio, digitise, expose, surroundings
from vbaa_calib.simulate.scene.scene import Joints, OverSpec, SceneSpec, true_rod


@dataclass(frozen=True, eq=False)
class Strand:
    """A curve in the antenna frame, (N,) and (N, 3), with the radii (N,) and the paint of the tube around it."""

    arclength_m: np.ndarray
    points_m: np.ndarray
    radius_m: np.ndarray
    paint: float
    asymmetry: float = 0.0

    def cut(self, bounds_m: np.ndarray, step_m: float = 5e-4) -> list[Strand]:
        """The parts between increasing arc lengths, with nodes `step_m` apart: their axes are within a nanometre of
        the whole wire's."""
        if len(bounds_m) == 2:
            return [self]
        parts = [np.linspace(a, b, 4 + int((b - a) / step_m)) for a, b in pairwise(bounds_m)]
        return [
            replace(
                self,
                arclength_m=s,
                points_m=core.simulate.spline(self.arclength_m, self.points_m, s)[0],
                radius_m=np.interp(s, self.arclength_m, self.radius_m),
            )
            for s in parts
        ]

    def seen(self, scene: SceneSpec, lamp_camera: np.ndarray) -> Tube:
        """The strand as a tube in the camera's picture."""
        points = scene.T_antenna_camera.inverse() @ self.points_m
        return tube(scene.lens, self.arclength_m, points, self.radius_m, lamp_camera)


def wires_of(scene: SceneSpec, arclength_m: np.ndarray, points_m: np.ndarray) -> list[Strand]:
    """The antenna, and its holder where the scene has one."""
    look = scene.picture
    thick = scene.radius_m * true_rod(scene).taper.diameter(arclength_m / scene.antenna.length_m)
    antenna = Strand(arclength_m, points_m, thick, look.antenna, look.shading_asymmetry)
    radius, length = scene.true.holder_m
    if radius <= 0 or length <= 0:
        return [antenna]
    s = np.linspace(-length, 0.0, 8)
    points = scene.true.clamp_offset_m + s[:, None] * np.array([1.0, 0.0, 0.0])
    return [antenna, Strand(s, points, np.full(len(s), radius), paint=0.07)]


def free_wires(scene: SceneSpec, joints: Joints) -> list[Strand]:
    """The free antenna at these joint angles, and its holder where the scene has one."""
    rod = true_rod(scene)
    gravity = scene.T_world_antenna(joints).rotation.T @ scene.gravity_world_m_s2
    shape = solve_rod(rod, gravity[None], np.array([rod.length_m]), np.zeros((1, 3)))
    return wires_of(scene, shape.arclength_m[0], shape.points_m[0])


def render_shot(
    scene: SceneSpec, place: Studio, sheet: Sheet, shot: BoardShot | AntennaShot, rng: np.random.Generator
) -> np.ndarray:
    """(height, width) uint8, the picture as the camera delivers it."""
    T_world_camera = scene.T_world_camera(shot.joints)
    canvas = surroundings(place, T_world_camera.rotation)
    patches: Iterable[ImagePatch]
    if isinstance(shot, BoardShot):
        patches = board_patches(place, sheet, shot.T_camera_board, T_world_camera.rotation)
    else:
        antenna = wires_of(scene, shot.arclength_m, shot.points_m)[0]
        own = _wire_patches(scene, place, antenna, T_world_camera, obstacle_of(scene, place, shot))
        patches = [*own, *_holder_patches(scene, place, shot.joints)]
        thing = None if shot.indentation_m is None else object_patch(place, scene.object, T_world_camera)
        canvas = canvas if thing is None else thing.over(canvas)
    return digitise(place.spec, expose(place, canvas, patches), rng)


def seen_antenna(scene: SceneSpec, shot: AntennaShot) -> Tube:
    """The antenna of this shot as a tube in the camera's picture."""
    antenna = wires_of(scene, shot.arclength_m, shot.points_m)[0]
    return antenna.seen(scene, scene.T_world_camera(shot.joints).rotation.T @ LAMP_WORLD)


def obstacle_of(scene: SceneSpec, place: Studio, shot: AntennaShot) -> DepthOfObstacle | None:
    """The object that may cover the antenna in this shot; None without one."""
    if shot.indentation_m is None:
        return None
    return obstacle(place, pressed_in(scene.object, shot.indentation_m), scene.T_world_camera(shot.joints))


def _wire_patches(
    scene: SceneSpec, place: Studio, wire: Strand, T_world_camera: Pose, hidden_by: DepthOfObstacle | None = None
) -> list[ImagePatch]:
    seen = wire.seen(scene, T_world_camera.rotation.T @ LAMP_WORLD)
    return tube_patches(place, seen, wire.paint, wire.asymmetry, hidden_by)


def _holder_patches(scene: SceneSpec, place: Studio, joints: Joints) -> list[ImagePatch]:
    """The holder, if there is one, which only the light from the lamp changes."""
    lamp = scene.T_world_antenna(joints).rotation.T @ LAMP_WORLD
    light = float(Tube.lit(np.sqrt(max(1.0 - lamp[0] ** 2, 0.0))))  # it lies along the antenna frame's x axis
    return [replace(patch, brightness=light * patch.brightness) for patch in _holder_in_full_light(scene, place)]


@lru_cache(maxsize=8)
def _holder_in_full_light(scene: SceneSpec, place: Studio) -> list[ImagePatch]:
    full = np.zeros(3)  # from a lamp across every tube
    return [
        patch
        for holder in wires_of(scene, np.linspace(0.0, 1.0, 4), np.zeros((4, 3)))[1:]
        for patch in tube_patches(place, holder.seen(scene, full), holder.paint, holder.asymmetry)
    ]


def render_over(
    scene: SceneSpec, place: Studio, sheet: Sheet, over: OverSpec, wires: list[Strand], rng: np.random.Generator
) -> np.ndarray:
    """(height, width) uint8 picture of these wires over the board under the antenna."""
    T_world_camera = scene.T_world_camera(over.joints)
    T_camera_board = scene.T_antenna_camera.inverse() @ over.T_antenna_board(sheet.spec)
    canvas = surroundings(place, T_world_camera.rotation)
    whole = board_patches(place, sheet, T_camera_board, T_world_camera.rotation, scene.lens.image_size[1])
    patches = [patch for wire in wires for patch in _wire_patches(scene, place, wire, T_world_camera)]
    for board in whole:  # one at most
        shaded = _shaded(scene, place, board, over, wires[0]) if over.shadow > 0 else board
        patches = [shaded, *(_in_front(canvas, patch, shaded) for patch in patches)]
    return digitise(place.spec, expose(place, canvas, patches), rng)


def _in_front(canvas: np.ndarray, patch: ImagePatch, board: ImagePatch) -> ImagePatch:
    """The board's patch with another patch in front of it, for `expose` to lay over the canvas.

    `expose` adds each patch's change of the canvas alone, so the difference between board and canvas goes into its
    brightness.
    """
    alpha, brightness = (_resampled(values, board, patch) for values in (board.alpha, board.brightness))
    lacking = patch.alpha * patch.packed(patch.behind(canvas) * alpha - brightness)
    return replace(patch, brightness=(patch.brightness + lacking).astype(np.float32))


def _resampled(values: np.ndarray, own: ImagePatch, other: ImagePatch) -> np.ndarray:
    """Values of one patch resampled to another's sub-pixels, side by side; zero outside the first."""
    scale = own.factor / other.factor
    shift = (np.array([other.left - own.left, other.top - own.top])) * own.factor + 0.5 * scale - 0.5
    inner = np.array([[scale, 0.0, shift[0]], [0.0, scale, shift[1]]])
    return cv2.warpAffine(
        own.laid_out(values), inner, other.alpha.shape[::-1], flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    )


def _shaded(scene: SceneSpec, place: Studio, board: ImagePatch, over: OverSpec, wire: Strand) -> ImagePatch:
    """The board with the wire's soft shadow on it."""
    lamp = scene.T_world_antenna(over.joints).rotation.T @ LAMP_WORLD
    fall = (wire.points_m[:, 2] + over.height_m) / max(float(lamp[2]), 0.2)
    shadow = replace(wire, points_m=wire.points_m - fall[:, None] * lamp)
    cast = [_resampled(patch.alpha, patch, board) for patch in tube_patches(place, shadow.seen(scene, lamp), 1.0)]
    if not cast:
        return board
    depth = float((scene.T_antenna_camera.inverse() @ shadow.points_m[len(fall) // 2])[2])
    soft = over.penumbra_m * float(np.diag(scene.lens.matrix)[:2].mean()) / depth * board.factor
    cover = cv2.GaussianBlur(np.sum(cast, axis=0), (0, 0), max(soft, 0.5))
    dimmed = board.packed(1.0 - over.shadow * np.minimum(cover, 1.0))
    return replace(board, brightness=(board.brightness * dimmed).astype(np.float32))
