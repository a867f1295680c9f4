"""The paper's rig in simulation: its pictures and readings, the ring-down of its antenna, and the object estimate."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh

from benchmarks.estimator.scenes import seen
from benchmarks.estimator.setup import TOWARDS_CLAMP, Setup, filling_pose, rod_of
from benchmarks.object.scenes import contact_table
from estimator.contact.contacts import Contacts
from estimator.object.estimate import ObjectEstimate, estimate_object
from vbaa_calib.antenna.rod import RodShape, sample_shape, solve_rod
from vbaa_calib.camera import Camera
from vbaa_calib.rig import Antenna, Rig

POINTS = 200
_FOCAL_WIDTHS, WIDTH_PX, SWING_M = 2.5, 512, 0.03


def paper_rig() -> Rig:
    """The rig as calibrated: weight, bow and a clamp that is off, known as well as an ordinary calibration knows."""
    focal = _FOCAL_WIDTHS * WIDTH_PX
    middle = 0.5 * (WIDTH_PX - 1)
    camera = Camera(
        "opencv", (WIDTH_PX, WIDTH_PX), np.array([[focal, 0, middle], [0, focal, middle], [0, 0, 1.0]]), np.zeros(0)
    )
    rig = Setup("none", image_size=(WIDTH_PX, WIDTH_PX), real=True, exact=False).rig()
    return replace(rig, camera=camera, T_antenna_camera=filling_pose(camera, 0.0, TOWARDS_CLAMP, SWING_M))


def free_shape(rig: Rig, gravity_m_s2: np.ndarray) -> RodShape:
    """The true antenna without contact, under gravity (B, 3), antenna frame."""
    rod = rod_of(rig)
    return solve_rod(rod, gravity_m_s2, np.full(len(gravity_m_s2), 0.5 * rod.length_m), np.zeros_like(gravity_m_s2))


def free_point(rig: Rig, distance_m: float) -> np.ndarray:
    """(3,) of the true antenna without contact at the joints' zero, at an arc length, antenna frame."""
    free = free_shape(rig, rig.gravity_world_m_s2[None])
    return np.array([np.interp(distance_m, free.arclength_m[0], free.points_m[0, :, axis]) for axis in range(3)])


@dataclass(frozen=True, eq=False)
class Pictures:
    """B frames as the true rig sees and feels them, without noise.

    points_px : (B, N, 2). moment_Nm : (B, 2) readings (τ_z, τ_y); the sensor about z is as good as the rig's.
    """

    points_px: np.ndarray
    moment_Nm: np.ndarray

    def noisy(self, rig: Rig, sigma_px: float, rng: np.random.Generator) -> Pictures:
        """With a draw of noise: points by `sigma_px`, readings by the sensor's."""
        return Pictures(
            self.points_px + rng.normal(0.0, sigma_px, self.points_px.shape),
            self.moment_Nm + rng.normal(0.0, rig.moment_sensor.std_Nm, self.moment_Nm.shape),
        )


def taken(true: Rig, shape: RodShape) -> Pictures:
    """The pictures and readings of antennas, by the true rig."""
    s = true.antenna.length_m * (np.arange(POINTS) + 0.5) / POINTS
    there = sample_shape(shape, np.broadcast_to(s, (len(shape.points_m), POINTS)))[0]
    moment = np.stack([shape.clamp_moment_Nm[:, 2], -shape.clamp_moment_Nm[:, 1]], axis=1)
    sensor = true.moment_sensor
    return Pictures(seen(true.camera, true.T_antenna_camera, there), sensor.gain * moment + sensor.offset_Nm)


_ELEMENTS, MODES = 60, 4
_DAMPING = 0.01
RATE_HZ, SAMPLES = 1000.0, 400
_PLUCK_NM = 3e-4
"""Change of the clamp's moment by which the antenna is let go."""

_SPRING = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4.0]])
_INERT = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4.0]])
"""Of an element with cubic shapes over (w, h·w′) at its ends, in EI/h³ and ρA·h/420."""


def ring_down(antenna: Antenna, contact_m: float, object_N_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Times (R,) s and moments (R,) N·m after the tip is let go, the antenna in contact with a spring.

    Euler–Bernoulli elements with cubic shapes; a contact that holds and lets turn; each mode damped by `_DAMPING`.
    """
    stiffness, mass, sites = _assembled(antenna, contact_m)
    held = int(np.argmin(np.abs(sites - contact_m)))
    rigid = 1e6 * antenna.stiffness_Nm2 / contact_m**3
    stiffness[2 * held, 2 * held] += min(object_N_m, rigid)
    # clamped: the first node's height and slope are none
    stiffness, mass = stiffness[2:, 2:], mass[2:, 2:]
    squares, shapes = eigh(stiffness, mass, subset_by_index=[0, MODES - 1])
    load = np.zeros(len(stiffness))
    load[-2] = 1.0
    started = shapes.T @ mass @ np.linalg.solve(stiffness, load)
    # w″(0) by the first free node's height and slope
    curvature = np.zeros(len(stiffness))
    curvature[:2] = 6.0 / sites[1] ** 2, -2.0 / sites[1]
    clamp = antenna.stiffness_Nm2 * shapes.T @ curvature
    amplitude = started * clamp
    amplitude = _PLUCK_NM * amplitude / np.abs(amplitude).sum()
    time = np.arange(SAMPLES) / RATE_HZ
    omega = np.sqrt(squares)[:, None]
    envelope = amplitude[:, None] * np.exp(-_DAMPING * omega * time)
    return time, (envelope * np.cos(omega * np.sqrt(1.0 - _DAMPING**2) * time)).sum(axis=0)


def _assembled(antenna: Antenna, contact_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stiffness and mass (2n, 2n) over heights and slopes of the nodes, which stand at (n,) m; one is the contact."""
    before = max(2, round(_ELEMENTS * contact_m / antenna.length_m))
    beyond = np.linspace(contact_m, antenna.length_m, max(2, _ELEMENTS - before) + 1)
    sites = np.concatenate([np.linspace(0.0, contact_m, before + 1), beyond[1:]])
    stiffness, mass = (np.zeros((2 * len(sites), 2 * len(sites))) for _ in range(2))
    for index, h in enumerate(np.diff(sites)):
        at = np.ix_(range(2 * index, 2 * index + 4), range(2 * index, 2 * index + 4))
        by_length = np.diag([1.0, h, 1.0, h])
        stiffness[at] += antenna.stiffness_Nm2 / h**3 * by_length @ _SPRING @ by_length
        mass[at] += antenna.mass_per_length_kg_m * h / 420.0 * by_length @ _INERT @ by_length
    return stiffness, mass, sites


_FRAME_RATE_HZ = 30.0
FELT = "all points, felt"
"""`estimator.object.estimate`: shape, slip, friction and compliance together, of the estimator's contacts."""


def object_of(
    rig: Rig, contacts: Contacts, pan_rad: np.ndarray, tilt_rad: np.ndarray, friction_rad: float
) -> ObjectEstimate:
    """What one recording's contacts say of the object; `friction_rad` as they were estimated with."""
    count = len(pan_rad)
    table = contact_table(contacts, pan_rad, tilt_rad, np.full(count, np.nan), np.arange(count) / _FRAME_RATE_HZ)
    return estimate_object(table, rig, friction_rad)
