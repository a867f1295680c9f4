"""A rig without any error, and frames of it drawn here: an antenna bent by one force, and something in front of it."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from estimator.table.contacts import Contact
from vbaa_calib.antenna.shape import Curves, bend
from vbaa_calib.camera import Camera
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig import RIG_PARAMETERS, Antenna, AntennaImage, MomentSensor, Rig

LENGTH_M, DIAMETER_M = 0.24, 0.001
FINE = 4
CONTACT_M, FORCE_N = 0.15, np.array([0.06, -0.03])


def rig_of(size: tuple[int, int]) -> Rig:
    """A camera of (width, height) px that looks down on the antenna, which fills two thirds of its picture."""
    focal = 0.95 * size[0]
    camera = Camera(
        "opencv", size, np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1]]), np.zeros(0)
    )
    turn = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0])).as_matrix()
    parameters = np.array([0, 0, 0, 0, 0.05, 0.0, np.log(3.9e-3), np.log(3.97e-3), 0.0])
    return Rig(
        camera=camera,
        T_antenna_camera=Pose(turn, np.array([0.12, 0.0, 0.35])),
        antenna=Antenna(LENGTH_M, DIAMETER_M, parameters),
        moment_sensor=MomentSensor(1.0, 0.0, 2e-5),
        kinematics=Kinematics(Pose.identity(), np.zeros(3)),
        gravity_world_m_s2=np.array([0.0, 0.0, -9.80665]),
        image=AntennaImage(0.05, 1.0, True),
        covariance=1e-10 * np.eye(len(RIG_PARAMETERS)),
    )


def shape(rig: Rig, force_N: np.ndarray = FORCE_N) -> Curves:
    """The antenna under the force (2,) at `CONTACT_M`, a batch of one."""
    gravity = rig.gravity_world_m_s2[None]
    return bend(rig.antenna.parameters[None], LENGTH_M, gravity, np.array([CONTACT_M]), force_N[None], sweeps=3)


def path_px(rig: Rig, curves: Curves) -> np.ndarray:
    """(M, 2) pixels of the antenna, evenly spaced by about one."""
    points = curves.points_m[0]
    along = np.linspace(0.0, 1.0, 4 * rig.camera.image_size[0])
    dense = [np.interp(along * LENGTH_M, curves.arclength_m[0], points[:, i]) for i in range(3)]
    return rig.camera.project(rig.T_antenna_camera.inverse() @ np.stack(dense, axis=1))[0]


def picture(
    rig: Rig, curves: Curves | None, hidden: tuple[float, float] | None = None, noise: float = 2.0, seed: int = 0
) -> np.ndarray:
    """(H, W) uint8: a bright antenna, or none, on uneven light; a grey plate hides from one share of its path on."""
    width, height = rig.camera.image_size
    rng = np.random.default_rng(seed)
    image = 40.0 + 20.0 * np.linspace(0, 1, width)[None] + 8.0 * np.sin(np.linspace(0, 9, height))[:, None]
    if curves is not None:
        path = path_px(rig, curves)
        fine = np.zeros((FINE * height, FINE * width), np.uint8)
        thick = max(2, round(FINE * DIAMETER_M * rig.camera.matrix[0, 0] / 0.35))
        places = np.rint(((path[::4] + 0.5) * FINE - 0.5) * 16).astype(np.int32)
        cv2.polylines(fine, [places], False, 255, thick, cv2.LINE_8, 4)
        line = cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA)
        image = image + 110.0 * cv2.GaussianBlur(line, (0, 0), 0.8) / 255.0
        if hidden is not None:
            piece = path[int(hidden[0] * len(path)) : int(hidden[1] * len(path))]
            low, high = piece.min(axis=0) - np.array([0, 30]), piece.max(axis=0) + np.array([0, 60])
            cv2.rectangle(image, np.rint(low).astype(int).tolist(), np.rint(high).astype(int).tolist(), 95.0, -1)
    return np.clip(image + rng.normal(0.0, noise, image.shape), 0, 255).astype(np.uint8)


def contact_of(status: str, curves: Curves) -> Contact:
    """A contact with this status, located where it may be."""
    if status not in ("ok", "tip_contact"):
        return Contact(
            status=status, reason=f"the reason for {status}", model="rod", in_contact=True, moment_residual_Nm=1e-6
        )
    point, force = curves.contact_m[0], curves.force_N[0]
    return Contact(
        status=status,
        reason="elastica: its bias is 0.1 std",
        model="elastica",
        in_contact=True,
        distance_m=CONTACT_M,
        distance_std_m=5e-4,
        force_N=force,
        force_std_N=np.full(3, 1e-4),
        deflection_m=np.zeros(3),
        point_antenna_m=point,
        point_world_m=point,
        covariance_world_m2=np.diag([6e-4, 2e-4, 3e-4]) ** 2,
        force_world_N=force,
        moment_residual_Nm=1e-6,
    )
