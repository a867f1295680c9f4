"""A press out of what a calibrated rig records: pixels to plane C, readings to moments, the free antenna taken off."""

from __future__ import annotations

import numpy as np

from vbaa_calib.core.errors import InputError
from vbaa_calib.rig import Rig

from .press import Noise, Press, Ring, Wire, tared, world_turn


def press_seen(
    rig: Rig,
    centrelines_px: np.ndarray,
    moments_Nm: np.ndarray,
    free_px: np.ndarray,
    free_moments_Nm: np.ndarray,
    pan_rad: np.ndarray,
    tilt_rad: np.ndarray,
    *,
    sigma_px: float | None = None,
    ring: Ring | None = None,
) -> Press:
    """What every method of `METHODS` is given of one touch, from first contact on.

    Parameters
    ----------
    centrelines_px : (F, N, 2), NaN where nothing is seen. moments_Nm : (F, 2) readings (about z, about y); a column of
        NaN where there is no sensor. pan_rad, tilt_rad : (F,).
    free_px, free_moments_Nm : (1 or F, M, 2) and (1 or F, 2) of the free antenna, at the same joint angles or at one
        pose that has the same weight across the antenna.
    sigma_px : of a point; by default what the rig's own pictures showed.

    Raises
    ------
    InputError : arrays that do not fit together, or too few points of the free antenna.
    """
    rotations, _ = rig.kinematics.world_antenna(np.asarray(pan_rad, float), np.asarray(tilt_rad, float))
    return Press(
        wire_of(rig),
        noise_of(rig, rig.image.noise_px if sigma_px is None else sigma_px),
        world_turn(rotations),
        contact_moments(rig, moments_Nm, free_moments_Nm),
        deflections(rig, centrelines_px, free_px),
        ring=ring,
    )


def deflections(rig: Rig, centrelines_px: np.ndarray, free_px: np.ndarray) -> np.ndarray:
    """(F, N, 2) x on plane C, and y less the free antenna's, of centrelines (F, N, 2) and (1 or F, M, 2) px."""
    layer = rig.camera_on_plane()
    bent, free = (layer.project(np.asarray(pixels, float))[0] for pixels in (centrelines_px, free_px))
    if len(free) not in (1, len(bent)):
        raise InputError(f"{len(free)} free antennas for {len(bent)} frames", remedy="give one, or one for each")
    free = np.broadcast_to(free, (len(bent), *free.shape[1:]))
    return np.stack([tared(one[None], line)[0] for one, line in zip(bent, free, strict=True)])


def contact_moments(rig: Rig, moments_Nm: np.ndarray, free_moments_Nm: np.ndarray) -> np.ndarray:
    """(F, 2) true moments of the contact from readings (F, 2) (about z, about y): offset and weight drop out."""
    second = rig.second_moment_sensor
    gain = np.array([rig.moment_sensor.gain if second is None else second.gain, rig.moment_sensor.gain])
    return (np.asarray(moments_Nm, float) - np.asarray(free_moments_Nm, float)) / gain


def wire_of(rig: Rig) -> Wire:
    """The antenna as the calibration knows it."""
    stiffness, mass = rig.antenna.stiffness_Nm2, rig.antenna.mass_per_length_kg_m
    return Wire(
        rig.antenna.length_m,
        stiffness,
        mass,
        stiffness * rig.std("log_stiffness_Nm2"),
        mass * rig.std("log_mass_per_length_kg_m"),
    )


def noise_of(rig: Rig, sigma_px: float) -> Noise:
    """Of a point on plane C at the antenna's middle, of a reading less the free antenna's; joint angles are exact."""
    layer, sensor = rig.camera_on_plane(), rig.moment_sensor
    middle = np.array([[0.5 * rig.antenna.length_m, 0.0, 0.0]])
    pixels, _ = rig.camera.project(rig.T_antenna_camera.inverse() @ middle)
    scale = float(np.sqrt(np.abs(np.linalg.det(layer.pixel_jacobian(pixels)))[0]))
    return Noise(sigma_px * scale, float(np.sqrt(2.0)) * sensor.std_Nm / sensor.gain, 0.0)
