"""What a system of the paper's family knows of one touch, and what it answers.

A *press* begins at first contact: the base turns on, the object bends the antenna. Directions across the antenna are
counted (y, z). A turn (w_y, w_z) carries the tip of a free antenna by L·w; an object in its way bends the antenna back
along −w. A moment (τ_z, τ_y) stands for the force components (f_y, f_z): x·f_y − y·f_x and the paper's x·f_z − z·f_x.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from vbaa_calib.core.arrays import validate_arguments
from vbaa_calib.core.errors import InputError
from vbaa_calib.rig import Rig

_QUARTIC = 4  # degree of the no-load shape: that of a beam under its own weight


@validate_arguments
@dataclass(frozen=True)
class Wire:
    """A straight, uniform antenna, with the standard deviations of its calibration. ρA, which only ring-downs need,
    may be NaN."""

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


@validate_arguments
@dataclass(frozen=True, eq=False)
class Press:
    """F frames of one touch in order of time, the last of which is to be answered; None for sensors that are
    missing.

    Attributes
    ----------
    turn_rad : (F, 2) turns (w_y, w_z) of the base since first contact.
    moment_Nm : (F, 2) moments (τ_z, τ_y) by the contact alone; a column of NaN without that sensor.
    points_m : (F, N, 2) centreline on plane C, its y less the free antenna's; NaN where nothing is seen.
    camera_tilt_rad : the paper's ϕ; 0 is camera A.
    ring : (R, 2) times, s, and the moment signal, N·m, of a ring-down against the object.
    point_std_m, moment_std_Nm, turn_std_rad : of the independent measurements; NaN where unknown.
    """

    wire: Wire
    turn_rad: np.ndarray | None = None
    moment_Nm: np.ndarray | None = None
    points_m: np.ndarray | None = None
    camera_tilt_rad: float = 0.0
    ring: np.ndarray | None = None
    point_std_m: float = np.nan
    moment_std_Nm: float = np.nan
    turn_std_rad: float = np.nan

    def __post_init__(self) -> None:
        counts = set()
        for name, shape in (("turn_rad", "(F, 2)"), ("moment_Nm", "(F, 2)"), ("points_m", "(F, N, 2)")):
            values = getattr(self, name)
            if values is None:
                continue
            if np.ndim(values) != shape.count(",") + 1 or np.shape(values)[-1] != 2:
                raise InputError(f"{name} has shape {np.shape(values)}", where="press", remedy=f"give {shape}")
            counts.add(len(values))
        if self.ring is not None and (np.ndim(self.ring) != 2 or np.shape(self.ring)[1] != 2):
            raise InputError(f"ring has shape {np.shape(self.ring)}", where="press", remedy="give (R, 2)")
        if len(counts) > 1 or 0 in counts:
            raise InputError("turns, moments and centrelines differ in number", where="press", remedy="give F of each")

    @property
    def has(self) -> frozenset[str]:
        """The measurements that it has, by the names in `methods.METHODS`."""
        read = np.zeros(2, bool) if self.moment_Nm is None else np.isfinite(self.moment_Nm).all(axis=0)
        found = {
            "turns": self.turn_rad is not None and bool(np.isfinite(self.turn_rad).all()),
            "moment_z": bool(read[0]),
            "moment_y": bool(read[1]),
            "centreline": self.points_m is not None,
            "ring": self.ring is not None and bool(np.isfinite(self.wire.mass_per_length_kg_m)),
        }
        return frozenset(name for name, there in found.items() if there)


@dataclass(frozen=True, eq=False)
class Answer:
    """A system's answer for the press's last frame. NaN for what it cannot determine, with the `reason`.

    Attributes
    ----------
    distance_m, distance_std_m : arc length of the contact. Deviations are NaN where the noise is not known.
    force_N, force_std_N : (3,) the object's force on the antenna, antenna frame.
    object_stiffness_N_m, object_stiffness_std_N_m : the environment's.
    candidates_m : (K,) distances that explain the data equally well, where they are several.
    """

    distance_m: float = np.nan
    distance_std_m: float = np.nan
    force_N: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    force_std_N: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    object_stiffness_N_m: float = np.nan
    object_stiffness_std_N_m: float = np.nan
    candidates_m: np.ndarray = field(default_factory=lambda: np.empty(0))
    reason: str = ""


def _world_turn(rotations: np.ndarray) -> np.ndarray:
    """(F, 2) rotations (w_y, w_z), rad, of the antenna's x axis since the first of the base's rotations (F, 3, 3)."""
    now = np.einsum("ji,fj->fi", rotations[0], rotations[:, :, 0])
    off_axis = np.linalg.norm(now[:, 1:], axis=1, keepdims=True)
    angle = np.arctan2(off_axis, now[:, :1])
    return now[:, 1:] * np.divide(angle, off_axis, out=np.ones_like(angle), where=off_axis > 0.0)


def press_from_recording(
    rig: Rig,
    pictures: tuple[np.ndarray, np.ndarray],
    free: tuple[np.ndarray, np.ndarray],
    joints_rad: tuple[np.ndarray, np.ndarray],
    *,
    sigma_px: float | None = None,
    ring: np.ndarray | None = None,
) -> Press:
    """What every method of `METHODS` knows of one touch, from first contact on.

    pictures : centrelines (F, N, 2) px, NaN where nothing is seen; and moment readings (F, 2) about z and about y, NaN
        without a sensor.
    free : the same of the free antenna, (1 or F, M, 2) and (1 or F, 2), at the same joint angles or at one pose that
        has the same weight across the antenna.
    joints_rad : pan and tilt (F,).
    sigma_px : of a point; by default what the rig's own pictures showed. ring : as in `Press`.

    Raises
    ------
    InputError : arrays that do not fit together, or too few points of the free antenna.
    """
    layer, sensor, more = rig.camera_on_plane(), rig.moment_sensor, rig.wrench_sensor
    about_z = None if more is None or "mz" not in more.components else more.gain[more.components.index("mz")]
    bent, lines = (layer.project(np.asarray(pixels, float))[0] for pixels in (pictures[0], free[0]))
    if len(lines) not in (1, len(bent)):
        raise InputError(f"{len(lines)} free antennas for {len(bent)} frames", remedy="give one, or one for each")
    lines = np.broadcast_to(lines, (len(bent), *lines.shape[1:]))
    gain = np.array([sensor.gain if about_z is None else about_z, sensor.gain])
    rotations, _ = rig.kinematics.world_antenna(*(np.asarray(angle, float) for angle in joints_rad))
    stiffness, mass = rig.antenna.stiffness_Nm2, rig.antenna.mass_per_length_kg_m
    deviations = stiffness * rig.std("log_stiffness_Nm2"), mass * rig.std("log_mass_per_length_kg_m")
    # the joint angles count as exact, a point's noise as that at the antenna's middle
    middle = np.array([[0.5 * rig.antenna.length_m, 0.0, 0.0]])
    pixels, _ = rig.camera.project(rig.T_antenna_camera.inverse() @ middle)
    scale = float(np.sqrt(np.abs(np.linalg.det(layer.pixel_jacobian(pixels)))[0]))
    point_std = (rig.image.noise_px if sigma_px is None else sigma_px) * scale
    seen = np.empty(bent.shape)
    for place, points, line in zip(seen, bent, lines, strict=True):  # y less a quartic through the free antenna
        line = line[np.isfinite(line).all(axis=1)]
        if len(line) <= _QUARTIC:
            raise InputError(f"{len(line)} points of the free antenna", remedy=f"at least {_QUARTIC + 1} are needed")
        shape = np.polynomial.Polynomial.fit(line[:, 0], line[:, 1], _QUARTIC)
        place[:] = np.stack([points[:, 0], points[:, 1] - shape(points[:, 0])], axis=-1)
    return Press(
        Wire(rig.antenna.length_m, stiffness, mass, *deviations),
        _world_turn(rotations),
        # offset and weight drop out
        (np.asarray(pictures[1], float) - np.asarray(free[1], float)) / gain,
        seen,
        ring=ring,
        point_std_m=point_std,
        moment_std_Nm=float(np.sqrt(2.0)) * sensor.std_Nm / sensor.gain,
        turn_std_rad=0.0,
    )
