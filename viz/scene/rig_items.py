"""The rig at the instants of contact: shapes, camera and plane C, in the world frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from estimator.table.contacts import ContactTable, joint_angles
from vbaa_calib.antenna.shape import bend
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.images import read_picture
from vbaa_calib.rig import Rig
from vbaa_calib.session import load_session, read_recording

from .readable import thinned


@dataclass(frozen=True, eq=False)
class RigItems:
    """The rig at each of M instants; NaN where its joint angles are unknown.

    Attributes
    ----------
    poses : (M, 4, 4) T_world_antenna.
    bent_m : (M, N, 3) the antenna; free_m (M, N, 3): where it would be without the object.
    seen : (M, N + 1, 2) where the picture shows `bent_m`, and last the contact, as shares of its width and height.
    ghosts : (G,) the instants with antennas that are drawn faintly.
    antenna_radius_m : of the wire.
    plane_m : (4, 3) antenna frame: corners of the drawn patch of plane C.
    camera_m : (3,) antenna frame: the camera's centre.
    picture_m : (H, W, 3) antenna frame: where the picture is drawn, as the lens sees it; rows down, columns right.
    """

    poses: np.ndarray
    bent_m: np.ndarray
    free_m: np.ndarray
    seen: np.ndarray
    ghosts: np.ndarray
    antenna_radius_m: float
    plane_m: np.ndarray
    camera_m: np.ndarray
    picture_m: np.ndarray

    @property
    def drawn_radius_m(self) -> float:
        """Enlarged radius for drawing: a wire of 0.8 mm would be less than a pixel."""
        return 1.8 * self.antenna_radius_m


def rig_items(rig: Rig, table: ContactTable, rows: np.ndarray, main: int) -> RigItems:
    """The rig at the instants of these rows (M,); ghosts are some of the located contacts, evenly spread, without
    the row `main`.

    Raises InputError when the contacts are not of this rig.
    """
    angles = (angle[rows] for angle in joint_angles(rig.kinematics, table))
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = rig.kinematics.world_antenna(*angles)
    poses[~np.isfinite(poses).all(axis=(1, 2))] = np.nan
    spread = thinned(np.flatnonzero(table.located[rows]), 6)
    length = rig.antenna.length_m
    bent, free = (_shapes(rig, table, rows, poses, share) for share in (1.0, 0.0))
    return RigItems(
        poses=poses,
        bent_m=bent,
        free_m=free,
        seen=_seen(rig, np.concatenate([bent, table.point_world_m[rows, None]], axis=1), poses),
        ghosts=spread[spread != main],
        antenna_radius_m=rig.antenna.diameter_m / 2,
        plane_m=length * np.array([[0, -0.3, 0], [1.05, -0.3, 0], [1.05, 0.3, 0], [0, 0.3, 0]]),
        camera_m=rig.T_antenna_camera.translation_m,
        picture_m=rig.T_antenna_camera @ _picture_grid(rig.camera, 0.4 * length),
    )


def _shapes(rig: Rig, table: ContactTable, rows: np.ndarray, poses: np.ndarray, share: float) -> np.ndarray:
    """(M, N, 3) points of the antenna in the world under `share` of the estimated force; free where there is none."""
    length, count = rig.antenna.length_m, len(rows)
    rotation = np.where(np.isfinite(poses[:, :3, :3]), poses[:, :3, :3], 0.0)
    angle = np.nan_to_num(table.friction_angle_rad[rows])
    across = np.nan_to_num(np.column_stack([table.force_y_N[rows], table.force_z_N[rows]]))
    # `bend` takes the part along the antenna's normal there, which turns with the antenna
    size = np.nan_to_num(np.linalg.norm(table.force_world_N[rows], axis=1)) * np.cos(angle)
    across_m = np.hypot(*across.T)
    push = np.divide(size, across_m, out=np.zeros(count), where=(across_m > 0) & table.located[rows])
    curves = bend(
        np.repeat(rig.antenna.parameters[None], count, axis=0),
        length,
        np.einsum("mji,j->mi", rotation, rig.gravity_world_m_s2),
        np.clip(np.nan_to_num(table.distance_m[rows], nan=length / 2), 0.01 * length, length),
        share * push[:, None] * across,
        friction_rad=angle,
        taper=rig.antenna.taper,
    )
    return np.einsum("mij,mnj->mni", poses[:, :3, :3], curves.points_m) + poses[:, None, :3, 3]


def _seen(rig: Rig, points_m: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """(M, N, 2) image coordinates, relative to width and height, of points (M, N, 3) in the world; NaN outside the
    picture."""
    in_antenna = np.einsum("mji,mnj->mni", poses[:, :3, :3], points_m - poses[:, None, :3, 3])
    in_camera = rig.T_antenna_camera.inverse() @ np.nan_to_num(in_antenna).reshape(-1, 3)
    pixels, valid = rig.camera.project(in_camera)
    visible = valid & rig.camera.in_picture(pixels) & np.isfinite(in_antenna).all(axis=-1).ravel()
    shares = np.where(visible[:, None], (pixels + 0.5) / rig.camera.image_size, np.nan)
    return shares.reshape(*points_m.shape[:2], 2)


def _picture_grid(camera: Camera, depth_m: float) -> np.ndarray:
    """(H, W, 3) grid of points over the whole picture at a depth, camera frame, with the lens's distortion.

    Where the lens has no ray, that of a lens without distortion is drawn.
    """
    # nodes down and across of the drawn picture: between them the lens counts as straight
    rows, columns = (10, 13)
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(-0.5, width - 0.5, columns), np.linspace(-0.5, height - 0.5, rows))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    rays, valid = camera.unproject(pixels)
    straight = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(camera.matrix).T
    rays = np.where((valid & (rays[:, 2] > 0.1))[:, None], rays, straight)
    return (depth_m * rays / rays[:, 2:]).reshape(rows, columns, 3)


def session_pictures(folder: Path, frames: np.ndarray, image_size: tuple[int, int]) -> tuple[np.ndarray | None, ...]:
    """The recording's picture (H, W, 3) RGB of each frame (M,), None for a frame that has none.

    Raises InputError when the session is damaged, holds no picture of these frames, or one of another size.
    """
    paths = {frame.frame: frame.image for frame in read_recording(load_session(folder))}
    wanted = [paths.get(int(frame)) for frame in frames]
    if not any(wanted):
        raise InputError("holds no picture of these frames", where=folder, remedy="give the session of this recording")
    return tuple(None if path is None else small_picture(path, image_size) for path in wanted)


def small_picture(path: Path, image_size: tuple[int, int]) -> np.ndarray:
    """(H, W, 3) RGB reduced picture. Raises InputError when it cannot be read or is not of `image_size` (width,
    height)."""
    pixels = read_picture(path)
    height, width = pixels.shape[:2]
    if (width, height) != tuple(image_size):
        what = f"is {width} x {height} pixels, the rig's camera {image_size[0]} x {image_size[1]}"
        raise InputError(what, where=path, remedy="give a picture of this rig's camera")
    factor = min(360 / width, 1.0)
    size = (max(round(factor * width), 1), max(round(factor * height), 1))
    small = cv2.resize(np.clip(pixels, 0, 255).astype(np.uint8), size, interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(small, cv2.COLOR_GRAY2RGB if small.ndim == 2 else cv2.COLOR_BGR2RGB)
