"""Sessions with a jig, of rigs drawn widely, and what people get wrong about it: the free antenna's lines say which."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from targets.board import BoardSpec, corner_points
from vbaa_calib.antenna.shape import bend
from vbaa_calib.calibrate.antenna.inputs import Observation
from vbaa_calib.calibrate.pose.board_pose import BoardPose
from vbaa_calib.camera import Camera
from vbaa_calib.diagnose.jig import JigEvidence
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.session import NominalAntenna, Session, Still, gravity_antenna

from ..rod_scenes import GRAVITY_WORLD, camera_pose

BOARD = BoardSpec(squares_x=9, squares_y=6, square_m=0.012, marker_m=0.009)
SIGMA_PX, TIP_PX = 0.05, 0.15


@dataclass(frozen=True, eq=False)
class JigRig:
    """A rig as it is: its lens, where the camera and the board in the jig are, and the free antenna."""

    camera: Camera
    T_antenna_camera: Pose
    T_antenna_board: Pose
    nominal: NominalAntenna
    parameters: np.ndarray  # (9,) of the antenna


def drawn_rig(rng: np.random.Generator) -> JigRig:
    """Antennas of 60 to 500 mm, focal lengths of 300 to 2,000 px, cameras upright or inclined by up to 60°."""
    length, focal = float(np.exp(rng.uniform(np.log(0.06), np.log(0.5)))), float(rng.uniform(300.0, 2000.0))
    width = round(focal * rng.uniform(0.9, 1.3))
    size = (width, round(0.75 * width))
    incline = 0.0 if rng.uniform() < 0.3 else rng.uniform(0.0, np.pi / 3)
    distance = focal * length / (0.6 * width)
    view = camera_pose(incline, rng.uniform(0, 2 * np.pi), distance)
    view = Pose(view.rotation, view.translation_m + np.array([length / 2 - 0.12, 0.0, 0.0]))
    matrix = np.array([[focal, 0, 0.5 * width + 3.0], [0, 1.002 * focal, 0.375 * width - 2.0], [0, 0, 1]])
    std = np.array([1e-3 * focal, 1e-3 * focal, 1e-3 * width, 1e-3 * width, 2e-3, 4e-3, 2e-4, 2e-4])
    camera = Camera("opencv", size, matrix, np.array([-0.08, 0.03, 0.0002, -0.0003]), np.diag(std**2))
    side = rng.choice([-1.0, 1.0], 3)
    place = length * rng.uniform([0.15, 0.12, 0.04], [0.4, 0.3, 0.1]) * side
    turn = Rotation.from_rotvec(0.05 * rng.normal(size=3)) * Rotation.from_rotvec([np.pi, 0.0, 0.0])
    stds = np.array([3e-4, 3e-4, 8e-3, 8e-3, 0.05, 0.05])
    diameter = 0.8e-3 * (length / 0.24) ** 1.3
    nominal = NominalAntenna(length, diameter, 193e9, 7900.0)
    rest = [np.log(nominal.stiffness_Nm2) + 0.05 * rng.normal(), np.log(nominal.mass_per_length_kg_m), 0.0]
    return JigRig(
        camera, view, Pose(turn.as_matrix(), place), nominal, np.concatenate([stds * rng.normal(size=6), rest])
    )


def reported(rig: JigRig, rng: np.random.Generator) -> JigEvidence:
    """What session.yaml and the pictures say of a rig, without a mistake."""
    stills = [Still(Path(f"noload_{index}.png"), 0.0, tilt, 0.0) for index, tilt in enumerate((0.0, 0.35, -0.35))]
    gravity = gravity_antenna(Kinematics(), GRAVITY_WORLD, stills)
    length = rig.nominal.length_m
    curves = bend(np.tile(rig.parameters, (3, 1)), length, gravity, np.full(3, 0.5 * length), np.zeros((3, 2)))
    view, lines = rig.T_antenna_camera.inverse(), []
    for index, still in enumerate(stills):
        s = np.linspace(0.01, 1.0, 200) * length
        points = np.stack([np.interp(s, curves.arclength_m[index], row) for row in curves.points_m[index].T], axis=1)
        pixels = rig.camera.project(view @ points)[0]
        tip = pixels[-1] + rng.normal(0.0, TIP_PX, 2)
        pixels = pixels + rng.normal(0.0, SIGMA_PX, pixels.shape)
        sigma = np.full(len(pixels), SIGMA_PX)
        lines.append(Observation(still, pixels, sigma, gravity[index], tip_px=tip, tip_std_px=TIP_PX))
    # the board is seen to a tenth of a millimetre
    std = np.array([3e-4] * 3 + [1e-4] * 3)
    seen = (view @ rig.T_antenna_board).retract(std * rng.normal(size=6))
    board = BoardPose(seen, np.diag(std**2), np.zeros((6, 8)), 0.05, 40, 0, None)
    session = Session(Path("."), BOARD, rig.nominal, rig.T_antenna_board, Kinematics(), GRAVITY_WORLD, 2e-5)
    return JigEvidence(session, rig.camera, board, (), stills, lines)


def _half_turn(axis: int, about: np.ndarray) -> Pose:
    rotation = Rotation.from_rotvec(np.pi * np.eye(3)[axis]).as_matrix()
    return Pose(rotation, about - rotation @ about)


def _shift(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Pose], Pose]:
    return lambda pose: Pose(pose.rotation, change(pose.translation_m))


MIDDLE = corner_points(BOARD).mean(axis=0) * [1, 1, 0]
SLIPS: dict[str, tuple[str, Callable[[Pose], Pose]]] = {
    "in cm": ("jig_unit", _shift(lambda at: 100.0 * at)),
    "in mm": ("jig_unit", _shift(lambda at: 1000.0 * at)),
    "in inch": ("jig_unit", _shift(lambda at: at / 0.0254)),
    "m for mm": ("jig_unit", _shift(lambda at: 1e-3 * at)),
    "sign of x": ("jig_sign", _shift(lambda at: at * [-1, 1, 1])),
    "sign of y": ("jig_sign", _shift(lambda at: at * [1, -1, 1])),
    "sign of z": ("jig_sign", _shift(lambda at: at * [1, 1, -1])),
    "x and y": ("jig_axes_exchanged", _shift(lambda at: at[[1, 0, 2]])),
    "x and z": ("jig_axes_exchanged", _shift(lambda at: at[[2, 1, 0]])),
    "y and z": ("jig_axes_exchanged", _shift(lambda at: at[[0, 2, 1]])),
    "half a turn about its corner": ("jig_turned", lambda pose: pose @ _half_turn(2, np.zeros(3))),
    "half a turn about its middle": ("jig_turned", lambda pose: pose @ _half_turn(2, MIDDLE)),
    "half a turn of the jig": ("jig_turned", lambda pose: _half_turn(2, np.zeros(3)) @ pose),
    "face down": ("jig_turned", lambda pose: pose @ _half_turn(0, np.zeros(3))),
    "inverse": ("jig_inverse", lambda pose: pose.inverse()),
}


def mistaken(evidence: JigEvidence, slip: Callable[[Pose], Pose]) -> JigEvidence:
    """The same with a slip in session.yaml."""
    pose = evidence.session.T_antenna_board
    assert pose is not None
    return replace(evidence, session=replace(evidence.session, T_antenna_board=slip(pose)))
