"""Joint angles of a recording, from where the free antenna first touches, and of a sweep, from what the camera sees."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate
from operator import mul

import numpy as np

from vbaa_calib.antenna.rod import solve_rod
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.native import core
from vbaa_calib.simulate.contact.stick_slip import Setting
from vbaa_calib.simulate.scene.lens import project
from vbaa_calib.simulate.scene.scene import Joints, SceneSpec, Sweep


@dataclass(frozen=True)
class _PathSettings:
    """Settings of the choice of joint angles that bring antenna and board to the wanted places."""

    points: int = 500  # along the antenna
    divisions: int = 4  # of the degree in which the object is first touched
    parts: int = 16  # into which a division cuts the part of first touch
    pan_rad: float = 0.5  # half range of a full sweep
    tilt_rad: float = 0.4  # half range of a full sweep
    # parts of a full sweep that are tried, largest first
    reaches: tuple[float, ...] = tuple(accumulate([1.0] + 21 * [0.9], mul))
    shares: tuple[float, ...] = (0.6, 0.5, 0.4, 0.32, 0.25)  # of the picture that the board may fill, that are tried
    turn_rad: tuple[float, float] = (0.35, -0.25)  # by which the board of a sweep is inclined about x and y


_PATHS = _PathSettings()


def _free_points(setting: Setting, kinematics: Kinematics, tilts_rad: np.ndarray) -> np.ndarray:
    """(B, 500, 3) centreline of the free antenna at each tilt, antenna frame; pan does not change gravity in it."""
    rod, poses = setting.rod, [kinematics.T_world_antenna(0.0, tilt) for tilt in tilts_rad]
    gravity = np.array([pose.rotation.T @ setting.gravity_world_m_s2 for pose in poses])
    shape = solve_rod(rod, gravity, np.full(len(poses), rod.length_m), np.zeros((len(poses), 3)))
    s = np.linspace(0.0, rod.length_m, _PATHS.points)
    return np.array(
        [
            np.stack([np.interp(s, arclength, points[:, axis]) for axis in range(3)], axis=1)
            for arclength, points in zip(shape.arclength_m, shape.points_m, strict=True)
        ]
    )


def _joints(press: str, pressed_rad: np.ndarray, other_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pan and tilt from the angles of the pressing and of the other joint."""
    return (pressed_rad, other_rad) if press == "pan" else (other_rad, pressed_rad)


def _first_touch(
    setting: Setting, kinematics: Kinematics, sweep: Sweep, points_antenna_m: np.ndarray, other_rad: float
) -> float:
    """Angle of the pressing joint, rad, at which the free antenna's points (N, 3), evenly from clamp to tip, first
    touch. Raises InputError."""
    radius_m = setting.radius_at(np.linspace(0.0, setting.rod.length_m, len(points_antenna_m)))
    angles = sweep.toward * np.deg2rad(np.arange(-70.0, 70.5, 1.0))
    for divided in range(_PATHS.divisions + 1):
        poses = kinematics.world_antenna(*_joints(sweep.press, angles, np.full_like(angles, other_rad)))
        # where the free antenna would penetrate the object
        hit = core.simulate.first_within(setting.object.numbers, *poses, points_antenna_m, radius_m)
        if divided == 0 and hit in (0, len(angles)):
            raise InputError(
                f"the antenna never meets the object by {sweep.press} in the "
                f"{'positive' if sweep.toward > 0 else 'negative'} direction with the other joint at "
                f"{np.rad2deg(other_rad):.1f}°",
                remedy="move the object or sweep elsewhere",
            )
        first = angles[hit]
        angles = np.linspace(angles[hit - 1], first, _PATHS.parts + 1)
    return float(first)


def sweep_joints(setting: Setting, kinematics: Kinematics, sweep: Sweep) -> list[Joints]:
    """The frames of one stroke: free, pressed against the object while the other joint sweeps, free again."""
    swept = np.linspace(*sweep.sweep_rad, sweep.frames)
    phase = np.linspace(0.0, 2 * np.pi * sweep.swells, sweep.frames)
    push = sweep.push_rad[0] + (sweep.push_rad[1] - sweep.push_rad[0]) * (0.5 - 0.5 * np.cos(phase))
    points = _free_points(setting, kinematics, swept if sweep.press == "pan" else np.zeros_like(swept))
    touch = np.array([_first_touch(setting, kinematics, sweep, p, at) for p, at in zip(points, swept, strict=True)])
    before, after = np.full(sweep.free_frames, swept[0]), np.full(sweep.free_frames, swept[-1])
    clear = -sweep.clearance_rad * np.linspace(1.3, 1.0, sweep.free_frames)
    relative = np.concatenate([touch[0] + sweep.toward * clear, touch + sweep.toward * push])
    pressed = np.concatenate([relative, touch[-1] + sweep.toward * clear[::-1]])
    others = np.concatenate([before, swept, after])
    return [Joints(float(pan), float(tilt)) for pan, tilt in zip(*_joints(sweep.press, pressed, others), strict=True)]


def sweep_of_the_board(scene: SceneSpec, outline_m: np.ndarray) -> tuple[Pose, list[Joints]]:
    """T_world_board and joint angles of the widest sweep that keeps the whole sheet in the picture.

    outline_m : (n, 3) points around the sheet's edge, board frame. Raises InputError if there is no such sweep.
    """
    possible = []
    for share in _PATHS.shares:
        T_world_board = _board_in_front(scene, share)
        paths = ((reach, _pattern(reach)) for reach in _PATHS.reaches)
        widest = next((path for path in paths if _in_view(scene, outline_m, T_world_board, path[1])), None)
        if widest is not None:
            possible.append((widest[0] * share, T_world_board, widest[1]))
    if not possible:
        raise InputError(
            "the board does not stay in view while the joints move",
            where=f"scene {scene.name}",
            remedy="take a shorter lens or a smaller board",
        )
    # a wide sweep and a large board both determine more
    return max(possible, key=lambda one: one[0])[1:]


def _pattern(reach: float) -> list[Joints]:
    moves = [
        *((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)),
        *((0.5 * pan, 0.5 * tilt) for pan, tilt in ((1, 1), (-1, -1), (1, -1), (-1, 1))),
    ]
    return [
        Joints(round(reach * _PATHS.pan_rad * pan, 6), round(reach * _PATHS.tilt_rad * tilt, 6)) for pan, tilt in moves
    ]


def _board_in_front(scene: SceneSpec, share: float) -> Pose:
    """T_world_board of a tilted board in the middle of the picture with the joints at zero, filling a share of it."""
    size = np.array(scene.board.size_m)
    focal = np.diag(scene.lens.matrix)[:2]
    distance = float((focal * size / (share * np.array(scene.lens.image_size))).max())
    turn = Pose.from_rotvec(np.array([*_PATHS.turn_rad, 0.0]), np.zeros(3)).rotation
    T_camera_board = Pose(turn, np.array([0.0, 0.0, distance]) - turn[:, :2] @ scene.board.outline_m.mean(axis=0))
    return scene.T_world_camera(Joints(0.0, 0.0)) @ T_camera_board


def _in_view(scene: SceneSpec, outline_m: np.ndarray, T_world_board: Pose, joints: list[Joints]) -> bool:
    poses = [scene.T_world_camera(at).inverse() @ T_world_board for at in joints]
    pixels = project(scene.lens, np.array([pose @ outline_m for pose in poses]))
    inside = (pixels >= 0) & (pixels <= np.array(scene.lens.image_size) - 1)
    return bool(inside.all()) and all(pose.rotation[:, 2] @ pose.translation_m > 0 for pose in poses)
