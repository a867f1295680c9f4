"""A calibrated rig, read from rig.json and written to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vbaa_calib.camera import Camera, in_plane_axes
from vbaa_calib.camera.lens import from_core
from vbaa_calib.core.arrays import as_floats, fixed, of_shape, real_gravity, validate_arguments
from vbaa_calib.core.errors import InputError, Verdict, about, quoted
from vbaa_calib.core.files import read_json, write_json
from vbaa_calib.geometry import PLANE_C, Kinematics, Plane, Pose
from vbaa_calib.geometry.covariance import independent_axes, is_covariance
from vbaa_calib.session import DRIFTS, READINGS, Drift, MomentSensor, MovingClamp

from .parts import (
    ANTENNA_PARAMETERS,
    POSE_PARAMETERS,
    RIG_PARAMETERS,
    SCHEMA,
    Antenna,
    AntennaImage,
    NamedAntennas,
    Tip,
    kinematics_to_dict,
)

if TYPE_CHECKING:
    from vbaa_calib.camera import CameraOnPlane

    from .rig_file import Joint
    from .wrench_sensor import WrenchSensor


def _joint_covariance(joint: Joint, lens: tuple[str, ...], where: object) -> np.ndarray:
    """(17, 17), or (17 + P, 17 + P) with the P parameters of the lens. Raises InputError for other parameters or
    another shape."""
    rows, names = joint.covariance, tuple(joint.parameters)
    if names not in (RIG_PARAMETERS, RIG_PARAMETERS + lens) or {len(rows), *map(len, rows)} != {len(names)}:
        raise InputError(
            f"joint must give the covariance of {', '.join(RIG_PARAMETERS)}, and then of the lens ({', '.join(lens)})",
            where=where,
            remedy="run vbaa calibrate again",
        )
    return np.array(rows, float)


def _of_camera(data: Mapping[str, Any], name: str) -> dict[str, Any]:
    """The data of rig.json for one of its `cameras` alone."""
    return (
        {key: value for key, value in data.items() if key != "cameras"} | data["cameras"][name] | {"camera_name": name}
    )


_OF_ALL_CAMERAS = ("antenna", "moment_sensor", "kinematics", "gravity_world_m_s2", "drift", "clamp", "antennas")


def _check_view(T_antenna_camera: Pose, length_m: float, where: object) -> None:
    """Raises InputError when no part of the undeformed antenna is in front of the camera."""
    along = np.linspace(0.0, length_m, 9)[:, None] * [1.0, 0.0, 0.0]
    depth_m = (T_antenna_camera.inverse() @ along)[:, 2]
    # what comes nearer to the camera's plane counts as not in front of it
    nearest_m = 1e-3
    if depth_m.max() < nearest_m:
        raise InputError(
            f"T_antenna_camera: the antenna is nowhere {1e3 * nearest_m:g} mm or more in front of the camera",
            where=where,
            remedy="it is the pose of the camera in the antenna frame, the camera's z forward",
        )


@lru_cache(maxsize=64)
def _is_covariance(matrix: bytes, size: int) -> bool:
    """`is_covariance` for the bytes of a matrix (size, size) in float64; cached, since a moved rig keeps its own."""
    return is_covariance(np.frombuffer(matrix).reshape(size, size))


@dataclass(frozen=True, eq=False, repr=False)
class Rig:
    """A calibrated rig. Its arrays are read-only: `dataclasses.replace` makes a changed one.

    Attributes
    ----------
    T_antenna_camera : pose of the camera in the antenna frame.
    covariance : (17 + P, 17 + P) joint covariance of `RIG_PARAMETERS` and the P parameters of the lens, in
        `parameter_names` order; (17, 17) where the lens counts as exact.
    moment_sensor : about y; `MomentSensor.none()` for a rig without, with zero covariance at gain and offset.
    wrench_sensor : what is read other than the moment about y; None where a rig has nothing of it.
    drift : what may have changed since; it is not in the covariance.
    tip : where the antenna's visible end lies; None where that is not known.
    clamp : what is known of a clamp that moves and turns between frames; None for one that does not.
    antennas : by name, where several in the same picture differ; each in the place of `antenna` (`of_antenna`).
    others : by name, rigs of further cameras that watch the same antenna; antenna, sensors, joints and drift are this
        rig's. Once the antenna and its readings are known, errors of one camera say nothing about another's.
    camera_name : of `camera`, among the others.
    verdict : what its calibration found, and whether it may be used.

    Raises InputError for other shapes, for what is no number, and for a matrix that is no covariance.
    """

    camera: Camera
    T_antenna_camera: Pose
    antenna: Antenna
    moment_sensor: MomentSensor
    kinematics: Kinematics
    gravity_world_m_s2: np.ndarray
    image: AntennaImage
    covariance: np.ndarray
    wrench_sensor: WrenchSensor | None = None
    drift: Drift = DRIFTS["none"]
    tip: Tip | None = None
    clamp: MovingClamp | None = None
    antennas: NamedAntennas = field(default_factory=dict)
    verdict: Verdict = field(default_factory=Verdict)
    others: Mapping[str, Rig] = field(default_factory=dict)
    camera_name: str = "camera"

    def __post_init__(self) -> None:
        again, tip = "run vbaa calibrate again", self.tip
        for name, kind in (("camera", Camera), ("T_antenna_camera", Pose), ("antenna", Antenna)):
            if not isinstance(getattr(self, name), kind):
                raise InputError(f"{name} is {quoted(getattr(self, name))}", remedy=f"give a {kind.__name__}")
        for name in ("rotation", "translation_m"):
            of_shape(values := getattr(self.T_antenna_camera, name), values.shape, f"{name} of T_antenna_camera")
        of_shape(self.antenna.parameters, self.antenna.parameters.shape, "parameters of the antenna")
        covariance = as_floats(self.covariance, "joint.covariance", again)
        first, every = len(RIG_PARAMETERS), len(RIG_PARAMETERS) + len(self.camera.parameter_names)
        if covariance.shape not in ((first, first), (every, every)):
            remedy = f"give ({first}, {first}), or ({every}, {every}) with the lens"
            raise InputError(f"joint.covariance has shape {covariance.shape}", remedy=remedy)
        if not (np.isfinite(covariance).all() and _is_covariance(covariance.tobytes(), len(covariance))):
            raise InputError("joint.covariance is not a covariance", remedy=again)
        whole, sensor = covariance, self.wrench_sensor
        if sensor is not None and len(own := sensor.covariance):
            fits = own.shape[1] == len(covariance) + len(own)
            whole = sensor.joined(covariance)
            if not (fits and _is_covariance(whole.tobytes(), len(whole))):
                what = f"wrench_sensor.covariance does not match the {len(covariance)} joint.parameters"
                raise InputError(what, remedy=again)
        if tip is not None and not (
            len(tip.covariance) == len(whole) and _is_covariance(tip.joint_with(whole).tobytes(), len(whole) + 1)
        ):
            raise InputError(f"antenna.tip.covariance does not match the {len(whole)} joint.parameters", remedy=again)
        try:
            gravity = real_gravity(fixed(self.gravity_world_m_s2, (3,), "gravity_world"))
        except ValueError as error:
            raise InputError(f"gravity_world {error.args[0]}", remedy=error.args[1]) from None
        object.__setattr__(self, "covariance", fixed(covariance, covariance.shape, "joint.covariance"))
        object.__setattr__(self, "gravity_world_m_s2", gravity)
        if self.others:
            object.__setattr__(self, "others", self._others())

    def _others(self) -> dict[str, Rig]:
        """The further cameras' rigs, with the shared parts of this one. Raises InputError."""
        same = {name: getattr(self, name) for name in _OF_ALL_CAMERAS}
        others, sensor = {}, self.wrench_sensor
        for name, rig in self.others.items():
            if name == self.camera_name or rig.others:
                raise InputError(f"two cameras are called {name}", where="cameras", remedy="give each its own name")
            of_camera = rig.wrench_sensor if sensor is not None and len(sensor.covariance) else sensor
            if rig.with_lens != self.with_lens or (of_camera is None) != (sensor is None):
                remedy = "give it with the lens, and the sensors, of the first one"
                raise InputError(f"the covariance of camera {name} is of other parameters", remedy=remedy)
            if self.tip is not None and rig.tip is None:
                raise InputError(f"camera {name} does not know the antenna's tip", remedy="run vbaa calibrate again")
            tip = None
            if self.tip is not None and rig.tip is not None:
                kept = rig.tip.offset_m == self.tip.offset_m
                tip = rig.tip if kept else replace(rig.tip, offset_m=self.tip.offset_m)
            own = same | {"tip": tip, "wrench_sensor": of_camera, "camera_name": name}
            kept = all(getattr(rig, key) is each for key, each in own.items())
            others[name] = rig if kept else replace(rig, **own)
        return others

    @property
    def cameras(self) -> dict[str, Rig]:
        """The rig of each camera alone, by name; the first one's is this rig's."""
        return {self.camera_name: replace(self, others={}) if self.others else self, **self.others}

    @property
    def image_sizes(self) -> dict[str, tuple[int, int]]:
        """(width, height) of each camera's pictures by name; "" for the only camera."""
        sizes = {name: one.camera.image_size for name, one in self.others.items()}
        return {self.camera_name if sizes else "": self.camera.image_size, **sizes}

    @property
    def lenses(self) -> Camera | dict[str, Camera]:
        """The only camera, or several cameras by name."""
        return {name: one.camera for name, one in self.cameras.items()} if self.others else self.camera

    @property
    def axes(self) -> np.ndarray:
        """(Q, R) independent steps of `covariance_with_tip`, one standard deviation long; with several cameras first
        those of the antenna and its readings, then, camera by camera, those that change neither."""
        first = axes = independent_axes((replace(self, others={}) if self.others else self).covariance_with_tip)
        pose, joint, lens = len(POSE_PARAMETERS), len(RIG_PARAMETERS), len(self.covariance)
        both = np.r_[pose:joint, lens : len(first)]
        if self.others:
            # what is known exactly has no axis: turned, it would have one
            size = np.abs(first).max(axis=0)
            first = first[:, size > 1e-12 * size.max()]
            known = both[first[both].any(axis=1)]
            unit = np.linalg.norm(first[known], axis=1, keepdims=True)
            first = axes = first @ np.linalg.qr((first[known] / unit).T, mode="complete")[0]
            first[both, len(known) :] = 0.0  # but for rounding
        shared = first[both]
        for other in self.others.values():
            alone, lens = independent_axes(other.covariance_with_tip), len(other.covariance)
            own, known = alone[np.r_[:pose, joint:lens]], alone[np.r_[pose:joint, lens : len(alone)]]
            unit = np.linalg.norm(known, axis=1, keepdims=True)
            unit[unit == 0.0] = 1.0
            back = np.linalg.pinv(known / unit, 1e-9)
            left = np.linalg.qr((own - own @ back @ (known / unit)).T)[1].T
            rows, columns = axes.shape
            axes = np.pad(axes, ((0, len(own)), (0, left.shape[1])))
            axes[rows:, : first.shape[1]], axes[rows:, columns:] = own @ back @ (shared / unit), left
        return axes

    def _split(self, count: int) -> list[np.ndarray]:
        """Indices of each camera's own parameters among all Q of a vector or matrix of size `count`; the first
        camera's alone if there are no others."""
        pose, joint = len(POSE_PARAMETERS), len(RIG_PARAMETERS)
        lens = len(self.camera.parameter_names)
        lenses = [len(each.camera.parameter_names) for each in self.others.values()]
        with_lens = count > joint + self._extra + sum(pose for _ in lenses)
        first = joint + with_lens * lens + self._extra
        places, at = [np.arange(first)], first
        for own in lenses:
            mine = np.arange(at, at := at + pose + with_lens * own)
            extra = np.arange(first - self._extra, first)
            places.append(np.concatenate([mine[:pose], np.arange(pose, joint), mine[pose:], extra]))
        if at != count:
            raise InputError(f"there are {count} numbers, the cameras' parameters are {at}", remedy="give all")
        return places

    def __repr__(self) -> str:
        size = "x".join(map(str, self.camera.image_size))
        antenna = f"antenna of {1e3 * self.antenna.length_m:.0f} mm, {self.words['stiffness']}"
        return f"<Rig: {self.camera.model} camera {size} px, {antenna}, verdict: {self.verdict.severity}>"

    @property
    def words(self) -> dict[str, str]:
        """Plane C, stiffness and sensor in words, ± one standard deviation."""
        sensor, off = self.moment_sensor, 1e3 * np.sqrt(np.diag(self.covariance)[:6])
        (x, y, z), EI = 1e3 * self.T_antenna_camera.translation_m, self.antenna.stiffness_Nm2
        more = self.wrench_sensor
        several = [] if more is None else [more.words]
        gain = f"gain {sensor.gain:.4f} ± {self.std('moment_gain'):.4f}, offset {1e3 * sensor.offset_Nm:.3f} mN·m"
        return {
            "plane C": f"camera at ({x:.1f}, {y:.1f}, {z:.1f}) mm in the antenna frame, ± {off[3:].max():.2g} mm, "
            f"± {off[:3].max():.2g} mrad",
            "stiffness": f"EI = {EI:.5g} ± {EI * self.std('log_stiffness_Nm2'):.2g} N·m²",
            "sensor": "; ".join([gain] * sensor.exists + several) or "none: vision alone",
        }

    def summary(self) -> str:
        """Camera, plane C, antenna, sensor and findings, a line each, ± one standard deviation."""
        camera, antenna, words = self.camera, self.antenna, self.words
        (fx, fy, cx, cy), size = camera.parameters[:4], "x".join(map(str, camera.image_size))
        lines = [
            f"lens       {camera.model} of {len(camera.distortion)} coefficients, {size} px, focal lengths "
            f"{fx:.1f} and {fy:.1f} px, centre ({cx:.1f}, {cy:.1f})",
            f"plane C    {words['plane C']}",
            f"antenna    {1e3 * antenna.length_m:.1f} mm long, {antenna.thickness} thick, {words['stiffness']}",
            f"sensor     {words['sensor']}",
        ]
        return "\n".join([*lines, *(f"{one.label:10s} {one}" for one in self.verdict.findings)])

    @cached_property
    def reading_noise(self) -> tuple[float, ...]:
        """Standard deviations of the readings, as `session.READINGS`, 0 for one that the rig does not have."""
        more = self.wrench_sensor
        known = {} if more is None else dict(zip(more.components, more.std.tolist(), strict=True))
        if self.moment_sensor.exists:
            known["my"] = self.moment_sensor.std_Nm
        return tuple(known.get(name, 0.0) for name in READINGS)

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns of our tables that its sensors' readings have."""
        return tuple(name for name, std in zip(READINGS.values(), self.reading_noise, strict=True) if std > 0.0)

    @validate_arguments
    def with_covariance(self, covariance: np.ndarray) -> Rig:
        """The rig with another joint covariance, (17 + P, 17 + P), or another `covariance_with_tip`, (17 + P + W +
        1, …)."""
        size = len(covariance) if covariance.ndim == 2 else 0
        if self.others:
            parts = [covariance[np.ix_(own, own)] for own in self._split(size)]
            rigs = [rig.with_covariance(part) for rig, part in zip(self.cameras.values(), parts, strict=True)]
            return replace(rigs[0], others=dict(zip(self.others, rigs[1:], strict=True)))
        if size < len(RIG_PARAMETERS) or covariance.shape != (size, size):
            raise InputError(f"covariance has shape {covariance.shape}", remedy="give (17 + P, 17 + P)")
        joint, tip, sensor = self._joint(size), self.tip, self.wrench_sensor
        if joint == size:
            return self._with_joint(covariance)
        if tip is not None:
            tip = replace(tip, std_m=float(np.sqrt(covariance[-1, -1])), covariance=covariance[-1, :-1])
            covariance = covariance[:-1, :-1]
        if sensor is not None and len(sensor.covariance):
            sensor = replace(sensor, covariance=covariance[joint:])
        return self._with(covariance[:joint, :joint], sensor, tip)

    def _with_joint(self, covariance: np.ndarray) -> Rig:
        """The rig with another joint covariance, (17 + P, 17 + P) or (17, 17); a lens that counted as exact is
        uncorrelated with the other parameters."""
        tip, sensor, size, extra = self.tip, self.wrench_sensor, len(covariance), self._extra - (self.tip is not None)

        def extended(rows: np.ndarray) -> np.ndarray:
            own = rows.shape[-1] - extra
            lens = np.zeros((*rows.shape[:-1], max(size - own, 0)))
            return np.concatenate([rows[..., :own][..., :size], lens, rows[..., own:]], axis=-1)

        if tip is not None:
            tip = replace(tip, covariance=extended(tip.covariance))
        if sensor is not None and extra:
            sensor = replace(sensor, covariance=extended(sensor.covariance))
        return self._with(covariance, sensor, tip)

    def _with(self, covariance: np.ndarray, sensor: WrenchSensor | None, tip: Tip | None) -> Rig:
        """The rig with another joint covariance and what is correlated with it, all at once."""
        lens = slice(len(RIG_PARAMETERS), None)
        camera = self.camera
        if len(covariance) > len(RIG_PARAMETERS):
            camera = replace(camera, covariance=covariance[lens, lens])
        return replace(self, covariance=covariance, camera=camera, tip=tip, wrench_sensor=sensor)

    @property
    def _extra(self) -> int:
        """Number of parameters that `covariance_with_tip` has after the joint ones: the wrench sensor's W, and the
        tip's."""
        return (self.tip is not None) + (0 if self.wrench_sensor is None else len(self.wrench_sensor.covariance))

    def _joint(self, size: int) -> int:
        """Number of joint parameters among the `size` of a covariance."""
        first = len(RIG_PARAMETERS)
        every = first + len(self.camera.parameter_names)
        whole = every if self.with_lens else first
        for joint in (whole, every, first):
            if size in (joint, joint + self._extra):
                return joint
        return size

    @property
    def covariance_with_tip(self) -> np.ndarray:
        """(17 + P + W + 1, …) the joint covariance followed by the wrench sensor's parameters and the tip's offset,
        where the rig has them, then pose and lens of each further camera."""
        if self.others:
            axes = self.axes
            return np.asarray(axes @ axes.T)
        sensor = self.wrench_sensor
        covariance = self.covariance if sensor is None else sensor.joined(self.covariance)
        return covariance if self.tip is None else self.tip.joint_with(covariance)

    @validate_arguments
    def drifted(self, part: float = 1.0) -> Rig:
        """The rig with the possible changes since its calibration added to the covariance, the lens's included.

        part : factor on the drift's deviations. Raises InputError for one below 0.
        """
        if not 0.0 <= part < np.inf:
            raise InputError(f"part is {part}", remedy="give a share, 0 or more")
        if part == 0.0 or not self.drift.of_rig:
            return self
        if self.others:
            return replace(
                replace(self, others={}).drifted(part),
                others={name: each.drifted(part) for name, each in self.others.items()},
            )
        covariance = self._drift_covariance(self.drift.times(part))
        covariance[: len(self.covariance), : len(self.covariance)] += self.covariance
        drifted = self._with_joint(covariance)
        sensor = drifted.wrench_sensor
        if sensor is None or not len(sensor.covariance):
            return drifted
        drift = self.drift.times(part)
        off = np.concatenate([np.zeros(3), drift.moment_gain * np.abs(sensor.gain), drift.moment_zero * sensor.std])
        own = sensor.covariance.copy()
        own[:, -len(off) :] += np.diag(off**2)
        return replace(drifted, wrench_sensor=replace(sensor, covariance=own))

    def _drift_covariance(self, drift: Drift) -> np.ndarray:
        """Covariance of the rig's own parameters by what may have changed since the calibration."""
        lens, first, pose = self.camera.parameter_names, len(RIG_PARAMETERS), len(POSE_PARAMETERS)
        std, scale = np.zeros((2, first + len(lens)))
        std[:3], std[3:pose] = drift.camera_turn_rad, drift.camera_shift_m
        std[pose + 2 : pose + 4], std[pose + 4 : pose + 6] = drift.clamp_turn_rad, drift.bow_per_m
        std[pose + ANTENNA_PARAMETERS.index("log_stiffness_Nm2")] = drift.stiffness
        if self.moment_sensor.exists:
            std[first - 2] = drift.moment_gain * abs(self.moment_sensor.gain)
            std[first - 1] = drift.moment_zero * self.moment_sensor.std_Nm
        std[[first + lens.index(name) for name in ("cx", "cy")]] = drift.picture_shift_px
        # one zoom for both focal lengths
        focal_px = np.diag(self.camera.matrix)[:2]
        scale[[first + lens.index(name) for name in ("fx", "fy")]] = drift.picture_scale * focal_px
        return np.diag(std**2) + np.outer(scale, scale)

    @validate_arguments
    def moved(self, step: np.ndarray) -> Rig:
        """The rig with its parameters changed by a step (17 + P,) or (17,), or one of all of `covariance_with_tip`;
        the covariance is unchanged."""
        if self.others:
            parts = self._split(len(step))
            rigs = [rig.moved(step[own]) for rig, own in zip(self.cameras.values(), parts, strict=True)]
            return replace(rigs[0], others=dict(zip(self.others, rigs[1:], strict=True)))
        tip, every, extra = self.tip, len(RIG_PARAMETERS) + len(self.camera.parameter_names), self._extra
        allowed = {len(RIG_PARAMETERS), every, every + extra, len(RIG_PARAMETERS) + extra}
        if step.ndim != 1 or len(step) not in allowed:
            raise InputError(f"step has shape {step.shape}", remedy=f"give one of {sorted(allowed)} numbers")
        joint, wrench = self._joint(len(step)), self.wrench_sensor
        if len(step) > joint:
            if tip is not None:
                tip, step = replace(tip, offset_m=tip.offset_m + float(step[-1])), step[:-1]
            if wrench is not None and len(wrench.covariance):
                wrench = wrench.moved(step[joint:])
            step = step[:joint]
        first, pose, antenna = len(RIG_PARAMETERS), len(POSE_PARAMETERS), self.antenna.parameters
        sensor = self.moment_sensor
        return replace(
            self,
            camera=self.camera.moved(step[first:]) if len(step) > first else self.camera,
            T_antenna_camera=self.T_antenna_camera.retract(step[:pose]),
            antenna=replace(self.antenna, parameters=antenna + step[pose : pose + len(antenna)]),
            moment_sensor=replace(
                sensor, gain=sensor.gain + float(step[first - 2]), offset_Nm=sensor.offset_Nm + float(step[first - 1])
            ),
            wrench_sensor=wrench,
            tip=tip,
        )

    @validate_arguments
    def step_from(self, other: Rig) -> np.ndarray:
        """(17 + P,) the step with which `other.moved` gives this rig; (17,) where their lens models differ."""
        now, then = self.moment_sensor, other.moment_sensor
        same_lens = self.camera.parameter_names == other.camera.parameter_names
        return np.concatenate(
            [
                self.T_antenna_camera.tangent_from(other.T_antenna_camera),
                self.antenna.parameters - other.antenna.parameters,
                [now.gain - then.gain, now.offset_Nm - then.offset_Nm],
                self.camera.parameters - other.camera.parameters if same_lens else [],
            ]
        )

    @validate_arguments
    def of_antenna(self, name: str) -> Rig:
        """The rig with the antenna of this name; with its only one where the rig names none. Raises InputError."""
        if not self.antennas:
            return self
        if name not in self.antennas:
            names = ", ".join(self.antennas)
            raise InputError(f"there is no antenna {name}", where="rig", remedy=f"it has {names}")
        (antenna, std), size = self.antennas[name], len(self.covariance)
        own = slice(len(POSE_PARAMETERS), len(POSE_PARAMETERS) + len(ANTENNA_PARAMETERS))
        others = np.setdiff1d(np.arange(size), np.arange(size)[own])
        covariance = np.zeros((size, size))
        covariance[np.ix_(others, others)], covariance[own, own] = (
            self.covariance[np.ix_(others, others)],
            np.diag(std**2),
        )
        return replace(self, antenna=antenna, covariance=covariance, tip=None, antennas={})

    @validate_arguments
    def camera_on_plane(self, plane: Plane = PLANE_C) -> CameraOnPlane:
        """The metric layer: pixels to metric coordinates on a plane of the antenna frame, plane C by default."""
        from vbaa_calib.camera import CameraOnPlane  # loads torch

        return CameraOnPlane(self.camera, self.T_antenna_camera, plane)

    def on_plane_C(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates (..., 2) m on plane C of pixels (..., 2), and validity (...): as `camera_on_plane().project`,
        but without torch, which takes a second to load."""
        points, known = from_core(self.camera.intrinsics, "on_plane", pixels, 2, "pixels", *self._plane_C())
        return points, known

    def plane_C_jacobian(self, pixels: np.ndarray) -> np.ndarray:
        """(..., 2, P + 6) derivatives as `camera_on_plane().calibration_jacobian`, at pixels (..., 2), without
        torch."""
        return from_core(self.camera.intrinsics, "plane_slopes", pixels, 2, "pixels", *self._plane_C(), True)[0]

    def _plane_C(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The camera's pose (3, 4), plane C's normal and offset (4,), and its axes (2, 3), for the core."""
        pose = np.column_stack([self.T_antenna_camera.rotation, self.T_antenna_camera.translation_m])
        return pose, np.append(PLANE_C.normal, PLANE_C.offset_m), in_plane_axes(PLANE_C)

    @property
    def with_lens(self) -> bool:
        """Whether the joint covariance includes the lens."""
        return len(self.covariance) > len(RIG_PARAMETERS)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the joint covariance's rows."""
        return RIG_PARAMETERS + (self.camera.parameter_names if self.with_lens else ())

    @property
    def joint_covariance(self) -> np.ndarray:
        """(17 + P, 17 + P) covariance of `RIG_PARAMETERS` and the lens; without correlations with the lens where
        these are unknown, and zero for an exact lens."""
        if self.with_lens:
            return self.covariance
        lens = self.camera.covariance
        joint, first = np.zeros((len(self.covariance) + len(self.camera.parameters),) * 2), len(self.covariance)
        joint[:first, :first], joint[first:, first:] = self.covariance, 0.0 if lens is None else lens
        return joint

    def plane_covariance(self) -> np.ndarray:
        """(P + 6, P + 6) covariance of lens and camera pose in the order of `CameraOnPlane.parameter_names`."""
        joint = self.joint_covariance
        order = np.r_[len(RIG_PARAMETERS) : len(joint), : len(POSE_PARAMETERS)]
        return joint[np.ix_(order, order)]

    @validate_arguments
    def std(self, parameter: str) -> float:
        """Standard deviation of one of `parameter_names`."""
        if parameter not in self.parameter_names:
            raise InputError(f"there is no parameter {parameter!r}", remedy=f"one of {', '.join(self.parameter_names)}")
        index = self.parameter_names.index(parameter)
        return float(np.sqrt(self.covariance[index, index]))

    @staticmethod
    @validate_arguments
    def load(path: str | Path) -> Rig:
        """Read a rig.json, or a YAML file of a stated rig. Raises InputError naming what is wrong in it."""
        path = Path(path)
        if path.suffix.lower() in (".yaml", ".yml"):
            from .stated import stated_rig

            return Rig.from_dict(stated_rig(path), path)
        return Rig.from_dict(read_json(path), path)

    @staticmethod
    @validate_arguments
    def from_dict(data: Mapping[str, Any], where: object = "rig") -> Rig:
        """The rig from the mapping that `to_dict` makes. Raises InputError naming the key that is wrong."""
        from vbaa_calib.core.models import checked  # loads pydantic, which a rig in memory does without

        from .rig_file import RigFile

        read = checked(RigFile, data, where, "`vbaa schema rig` prints what is expected")
        try:
            camera = Camera.from_dict(data["camera"])
        except InputError as error:
            raise InputError(f"camera: {error.what}", where=where, remedy=error.remedy) from None
        covariance = _joint_covariance(read.joint, camera.parameter_names, where)
        if len(covariance) > len(RIG_PARAMETERS):
            lens = slice(len(RIG_PARAMETERS), None)
            camera = replace(camera, covariance=covariance[lens, lens])
        _check_view(read.T_antenna_camera, read.antenna.length_m, where)
        sensor, axes = read.moment_sensor, read.kinematics.axes_uncertainty
        with about(where):
            return Rig(
                camera=camera,
                T_antenna_camera=read.T_antenna_camera,
                antenna=read.antenna.antenna(),
                moment_sensor=MomentSensor(sensor.gain, sensor.offset_Nm, sensor.std_Nm)
                if sensor
                else MomentSensor.none(),
                kinematics=replace(read.kinematics.kinematics(), axes_std=axes.std, axes_by_pose=axes.by_pose),
                gravity_world_m_s2=read.gravity_world,
                image=read.image,
                covariance=covariance,
                wrench_sensor=read.wrench,
                drift=read.drift,
                tip=read.antenna.tip,
                clamp=read.clamp,
                antennas={name: (each.antenna(), each.parameters_std) for name, each in read.antennas.items()},
                verdict=read.verdict,
                others={name: Rig.from_dict(_of_camera(data, name), where) for name in read.cameras},
                camera_name=read.camera_name,
            )

    @validate_arguments
    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write rig.json, completely or not at all. Raises InputError for an existing file, unless `force`."""
        write_json(Path(path), self.to_dict(), force, Rig.from_dict)

    def to_dict(self) -> dict[str, Any]:
        """The part of rig.json that describes the rig; whoever writes it adds the provenance."""
        first, more = self.moment_sensor, self.wrench_sensor
        std = {"gain_std": self.std("moment_gain"), "offset_std_Nm": self.std("moment_offset_Nm")}
        whole = {
            "schema": SCHEMA,
            "camera": self.camera.to_dict(),
            "T_antenna_camera": self.T_antenna_camera.to_dict(),
            "antenna": {**self.antenna.to_dict(self.std), **({} if self.tip is None else {"tip": self.tip.to_dict()})},
            "moment_sensor": asdict(first) | std if first.exists else None,
            **({} if more is None else {"wrench_sensor": more.to_dict()}),
            "kinematics": kinematics_to_dict(self.kinematics),
            "gravity_world": self.gravity_world_m_s2.tolist(),
            "image": asdict(self.image),
            "drift": asdict(self.drift),
            **({} if self.clamp is None else {"clamp": asdict(self.clamp)}),
            **(
                {}
                if not self.antennas
                else {"antennas": {name: one.stated(std) for name, (one, std) in self.antennas.items()}}
            ),
            "verdict": self.verdict.to_dict(),
            "joint": {"parameters": list(self.parameter_names), "covariance": self.covariance.tolist()},
        }
        if not self.others:
            return whole
        own = {name: replace(rig, verdict=self.verdict).to_dict() for name, rig in self.others.items()}
        always = {"camera", "T_antenna_camera", "image", "joint"}
        cameras = {
            name: {key: value for key, value in rig.items() if key in always or value != whole.get(key)}
            for name, rig in own.items()
        }
        return whole | {"camera_name": self.camera_name, "cameras": cameras}
