"""Presses of the static rod against synthetic objects: nothing here is the baselines' own mathematics."""

from __future__ import annotations

import numpy as np

from estimator.paper.baselines import Noise, Press, Ring, Wire
from estimator.paper.baselines.press import _world_turn
from vbaa_calib.antenna.rod import Rod, sample_shape
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.simulate.contact.touch import Touch, touch
from vbaa_calib.simulate.scene.objects import TouchObject

from . import vibrations

LENGTH_M, STIFFNESS_NM2, MASS_KG_M = vibrations.LENGTH, vibrations.EI, vibrations.DENSITY
WIRE = Wire(LENGTH_M, STIFFNESS_NM2, MASS_KG_M)
ROD = Rod(LENGTH_M, STIFFNESS_NM2, STIFFNESS_NM2 / 1.3, 0.0)
RADIUS_M = 4e-4


def knife(
    contact_m: float, normal_rad: float = 0.0, stiffness_N_m: float = np.inf, friction: float = 0.0
) -> TouchObject:
    """An edge across the antenna on its +y side, whose outward normal (yz plane) is turned from −y by an angle."""
    outward = np.array([0.0, -np.cos(normal_rad), -np.sin(normal_rad)])
    along = np.array([0.0, -np.sin(normal_rad), np.cos(normal_rad)])
    edge = np.array([contact_m, 0.0, 0.0]) - (RADIUS_M + 2e-4) * outward
    return TouchObject("knife_edge", edge, along, 2e-4, 0.2, stiffness_N_m, friction, wedge_world=-outward)


def pressed(obj: TouchObject, pan_rad: np.ndarray, tilt_rad: np.ndarray | float = 0.0) -> tuple[Touch, np.ndarray]:
    """The weightless rod at these joint angles (F,), and its base's rotations (F, 3, 3)."""
    rotations, _ = Kinematics().world_antenna(pan_rad, np.broadcast_to(tilt_rad, np.shape(pan_rad)))
    poses = [Pose(rotation, np.zeros(3)) for rotation in rotations]
    return touch(ROD, RADIUS_M, obj, poses, np.zeros(3)), rotations


def seen_square_on(touched: Touch, points: int = 200) -> np.ndarray:
    """(F, N, 2) the centreline's x and y."""
    s = np.linspace(0.005, 1.0, points) * LENGTH_M
    return sample_shape(touched.shape, np.broadcast_to(s, (len(touched.in_contact), points)))[0][..., :2]


def press_of(touched: Touch, rotations: np.ndarray, noise: Noise | None = None, seed: int | None = None) -> Press:
    """The press as it is, or with a draw of its noise."""
    moment = np.stack([touched.shape.clamp_moment_Nm[:, 2], -touched.shape.clamp_moment_Nm[:, 1]], axis=1)
    points, turn = seen_square_on(touched), _world_turn(rotations)
    if seed is not None and noise is not None:
        rng = np.random.default_rng(seed)
        moment = moment + rng.normal(0.0, noise.moment_Nm, moment.shape)
        turn = turn + rng.normal(0.0, noise.turn_rad, turn.shape)
        points = points + [0.0, 1.0] * rng.normal(0.0, noise.point_m, points.shape)
    return Press(WIRE, noise or Noise(), turn, moment, points)


def ringing(contact: float, amplitudes_Nm: tuple[float, ...], noise_Nm: float, rng: np.random.Generator) -> Ring:
    """0.4 s at 1 kHz of the moment of a wire rung at a contact (in lengths): its modes, each at 1 % damping."""
    waves, _ = vibrations.modes(contact, len(amplitudes_Nm))
    time = np.arange(400) / 1000.0
    signal = 3e-4 + rng.normal(0.0, noise_Nm, len(time))
    for wave, amplitude in zip(waves, amplitudes_Nm, strict=True):
        omega = vibrations.frequency_rad_s(wave)
        signal += amplitude * np.exp(-0.01 * omega * time) * np.cos(omega * np.sqrt(1 - 0.01**2) * time + 0.4)
    return Ring(time, signal)
