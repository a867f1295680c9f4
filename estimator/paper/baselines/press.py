"""What a system of the paper's family is given of one touch, and what it answers.

A *press* begins at first contact: the base turns on, the object bends the antenna. Directions across the antenna are
counted (y, z). A turn (w_y, w_z) carries the tip of a free antenna by L·w; an object in its way bends the antenna back
along −w. A moment (τ_z, τ_y) stands for the force components (f_y, f_z): x·f_y − y·f_x and the paper's x·f_z − z·f_x.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from vbaa_calib.core.errors import InputError
from vbaa_calib.rig import Rig

_QUARTIC = 4
"""Degree of the no-load shape: that of a beam under its own weight."""


@dataclass(frozen=True)
class Wire:
    """The antenna: straight, uniform. The deviations are those of its calibration.

    Attributes
    ----------
    stiffness_Nm2 : EI. mass_per_length_kg_m : ρA, which only ringing asks for; NaN where not known.
    """

    length_m: float
    stiffness_Nm2: float
    mass_per_length_kg_m: float = np.nan
    stiffness_std_Nm2: float = 0.0
    mass_per_length_std_kg_m: float = 0.0

    def __post_init__(self) -> None:
        if not (0.0 < self.length_m < np.inf and 0.0 < self.stiffness_Nm2 < np.inf):
            raise InputError(
                f"a wire of {self.length_m} m and {self.stiffness_Nm2} N·m²", remedy="give positive numbers"
            )


@dataclass(frozen=True)
class Noise:
    """Standard deviations of a press's numbers, independent of one another; NaN where not known."""

    point_m: float = np.nan
    moment_Nm: float = np.nan
    turn_rad: float = np.nan


@dataclass(frozen=True, eq=False)
class Ring:
    """The moment signal of an antenna left ringing against the object: times (R,) s, moments (R,) N·m."""

    time_s: np.ndarray
    moment_Nm: np.ndarray

    def __post_init__(self) -> None:
        if np.ndim(self.time_s) != 1 or np.shape(self.time_s) != np.shape(self.moment_Nm):
            raise InputError("a ring-down's times and moments differ in number", remedy="give (R,) of both")


@dataclass(frozen=True, eq=False)
class Press:
    """F frames of one touch in order of time; the last one is now.

    Attributes
    ----------
    turn_rad : (F, 2) turns (w_y, w_z) of the base since first contact; None where the base does not turn.
    moment_Nm : (F, 2) moments (τ_z, τ_y) by the contact alone, those of the free antenna taken off; a column of NaN
        where there is no such sensor, None without any.
    points_m : (F, N, 2) centreline as seen on plane C, deflections from the free antenna (`tared`), NaN where nothing
        is seen; None without a camera.
    camera_tilt_rad : the paper's ϕ; 0 is camera A.
    """

    wire: Wire
    noise: Noise = field(default_factory=Noise)
    turn_rad: np.ndarray | None = None
    moment_Nm: np.ndarray | None = None
    points_m: np.ndarray | None = None
    camera_tilt_rad: float = 0.0
    ring: Ring | None = None

    def __post_init__(self) -> None:
        for name, shape in (("turn_rad", "(F, 2)"), ("moment_Nm", "(F, 2)"), ("points_m", "(F, N, 2)")):
            values = getattr(self, name)
            if values is not None and (np.ndim(values) != shape.count(",") + 1 or np.shape(values)[-1] != 2):
                raise InputError(f"{name} has shape {np.shape(values)}", where="press", remedy=f"give {shape}")
        given = [values for values in (self.turn_rad, self.moment_Nm, self.points_m) if values is not None]
        if len({len(values) for values in given}) > 1 or any(len(values) == 0 for values in given):
            raise InputError("turns, moments and centrelines differ in number", where="press", remedy="give F of each")

    @property
    def has(self) -> frozenset[str]:
        """Which of `methods.NEEDS` it brings."""
        found = {"wire"}
        if self.turn_rad is not None and np.isfinite(self.turn_rad).all():
            found.add("turns")
        if self.moment_Nm is not None:
            felt = np.isfinite(self.moment_Nm).all(axis=0)
            found |= {name for name, there in zip(("moment_z", "moment_y"), felt, strict=True) if there}
        if self.points_m is not None:
            found.add("centreline")
        if self.ring is not None and np.isfinite(self.wire.mass_per_length_kg_m):
            found.add("ring")
        return frozenset(found)


@dataclass(frozen=True, eq=False)
class Answer:
    """What a system says of the press, at its last frame. NaN is what it cannot say; `reason` says why.

    Attributes
    ----------
    distance_m, distance_std_m : arc length of the contact. Deviations are NaN where the noise is not known.
    force_N, force_std_N : (3,) the object's force on the antenna, antenna frame.
    object_stiffness_N_m, object_stiffness_std_N_m : the environment's. `object_at_least_N_m` : two deviations below it.
    candidates_m : (K,) distances that explain the data equally well, where they are several.
    """

    distance_m: float = np.nan
    distance_std_m: float = np.nan
    force_N: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    force_std_N: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    object_stiffness_N_m: float = np.nan
    object_stiffness_std_N_m: float = np.nan
    object_at_least_N_m: float = np.nan
    candidates_m: np.ndarray = field(default_factory=lambda: np.empty(0))
    reason: str = ""


def subtract_free_antenna(points_m: np.ndarray, free_m: np.ndarray) -> np.ndarray:
    """Points (F, N, 2) on plane C with the free antenna's line taken off: y less a quartic through `free_m` (M, 2).

    The free antenna is to be seen at the same joint angles, so that the same weight bends it. Rows with NaN do not
    count. Raises InputError with fewer than five points.
    """
    free = free_m[np.isfinite(free_m).all(axis=1)]
    if len(free) <= _QUARTIC:
        raise InputError(f"{len(free)} points of the free antenna", remedy=f"at least {_QUARTIC + 1} are needed")
    line = np.polynomial.Polynomial.fit(free[:, 0], free[:, 1], _QUARTIC)
    return np.stack([points_m[..., 0], points_m[..., 1] - line(points_m[..., 0])], axis=-1)


def world_turn(rotations: np.ndarray) -> np.ndarray:
    """(F, 2) turns (w_y, w_z), rad, since the first of F base rotations R_world_antenna (F, 3, 3).

    By so much, and to that side, the antenna's x axis has turned from where it was.
    """
    now = np.einsum("ji,fj->fi", rotations[0], rotations[:, :, 0])
    aside = np.linalg.norm(now[:, 1:], axis=1, keepdims=True)
    angle = np.arctan2(aside, now[:, :1])
    return now[:, 1:] * np.divide(angle, aside, out=np.ones_like(angle), where=aside > 0.0)


def press_from_recording(
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
    return np.stack([subtract_free_antenna(one[None], line)[0] for one, line in zip(bent, free, strict=True)])


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
