"""A sensor of several components of the wrench at the clamp."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from vbaa_calib.core.arrays import as_floats, fixed
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.models import Number, read_as
from vbaa_calib.geometry import Pose
from vbaa_calib.session import READINGS, MomentSensor
from vbaa_calib.session.settings import FilePose

_PerChannel = Annotated[
    np.ndarray,
    read_as(
        Annotated[list[Annotated[Number, Field(ge=-1e9, le=1e9)]], Field(min_length=1, max_length=5)],
        lambda values: np.array(values, float),
    ),
]


def _rows(covariance: list[list[float]]) -> np.ndarray:
    if len({len(row) for row in covariance}) > 1:
        raise InputError(
            "covariance of the wrench sensor has rows of different lengths", remedy="run vbaa calibrate again"
        )
    return np.array(covariance, float) if covariance else np.zeros((0, 0))


@dataclass(frozen=True, eq=False)
class WrenchSensor:
    """The wrench components that a rig's sensor reads in addition to the moment about y, in the sensor's own,
    right-handed axes.

    reading = gain · component + offset + noise, of force and moment of contact and antenna's weight about the sensor's
    origin. Where it reads the moment about its y, too, that is the rig's `moment_sensor`, with a gain on the moment
    x·f_z − z·f_x: about −1 for a sensor that reads right-handed.

    Attributes
    ----------
    components : C of `session.READINGS`, in that order, without my.
    gain, offset, std : (C,) of each; offset and noise in N or N·m.
    T_antenna_sensor : pose of the sensor's axes in the antenna frame.
    covariance : (W, N + W) of its own parameters with the rig's N, of `Rig.covariance` and the tip's offset, and then
        with its own; (0, 0) where they count as exact.
    """

    components: Annotated[
        tuple[str, ...],
        read_as(Annotated[list[Literal["mz", "mx", "fx", "fy", "fz"]], Field(min_length=1, max_length=5)], tuple),
    ]
    gain: _PerChannel
    offset: _PerChannel
    std: _PerChannel
    T_antenna_sensor: FilePose
    covariance: Annotated[
        np.ndarray,
        read_as(list[list[Annotated[Number, Field(ge=-1e12, le=1e12)]]], _rows),
        Field(description="of turn, gains and offsets with joint.parameters, and then with themselves"),
    ]

    def __post_init__(self) -> None:
        """Raises InputError for unknown components and impossible numbers."""
        count, known = len(self.components), [name for name in READINGS if name != "my"]
        if list(self.components) != [name for name in known if name in self.components]:
            remedy = f"name each once, in the order {', '.join(known)}"
            raise InputError(f"components of the wrench sensor are {', '.join(self.components)}", remedy=remedy)
        for name in ("gain", "offset", "std"):
            values = fixed(
                as_floats(getattr(self, name), name, "give numbers"), (count,), f"{name} of the wrench sensor"
            )
            object.__setattr__(self, name, values)
        for name, bad in (("gain", np.abs(self.gain) < 1e-9), ("std", self.std <= 0.0)):
            if bad.any():
                which = self.components[int(np.argmax(bad))]
                raise InputError(f"{name} of {which} is {getattr(self, name)[bad][0]:g}", remedy="give another than 0")
        rows = np.shape(self.covariance)
        if rows != (0, 0) and (len(rows) != 2 or rows[0] != 3 + 2 * count or rows[1] < rows[0]):
            remedy = "run vbaa calibrate again"
            raise InputError(f"covariance of the wrench sensor has shape {rows}", remedy=remedy)
        object.__setattr__(self, "covariance", fixed(self.covariance, rows, "covariance of the wrench sensor"))

    @staticmethod
    def about_z(sensor: MomentSensor) -> WrenchSensor:
        """A second moment sensor about the antenna frame's z axis, with exact gain and offset."""
        gain, offset, std = (np.array([value]) for value in (sensor.gain, sensor.offset_Nm, sensor.std_Nm))
        return WrenchSensor(("mz",), gain, offset, std, Pose.identity(), np.zeros((0, 0)))

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """(W,) names of its covariance's rows."""
        if not len(self.covariance):
            return ()
        return (
            *(f"sensor_about_{axis}_rad" for axis in "xyz"),
            *(f"{name}_gain" for name in self.components),
            *(f"{name}_offset" for name in self.components),
        )

    @property
    def words(self) -> str:
        """Gains, and the uncertainty of its axes, in words."""
        gains = ", ".join(f"{name} {gain:.3f}" for name, gain in zip(self.components, self.gain, strict=True))
        known = (
            f"; axes ± {1e3 * np.sqrt(np.diag(self.own_covariance)[:3]).max():.2g} mrad" if len(self.covariance) else ""
        )
        return f"gains {gains}{known}"

    @property
    def own_covariance(self) -> np.ndarray:
        """(W, W) covariance of its own parameters."""
        return self.covariance[:, self.covariance.shape[1] - len(self.covariance) :]

    def joined(self, covariance: np.ndarray) -> np.ndarray:
        """(N + W, N + W) the rig's covariance (N, N), tip offset included, with the sensor's own parameters as the
        last."""
        size = len(self.covariance)
        if not size:
            return covariance
        across = np.zeros((size, len(covariance)))
        # of a lens that counted as exact nothing is in common
        known = min(self.covariance.shape[1] - size, len(covariance))
        across[:, :known] = self.covariance[:, :known]
        return np.block([[covariance, across.T], [across, self.own_covariance]])

    def moved(self, step: np.ndarray) -> WrenchSensor:
        """The sensor with its parameters moved by a step (W,)."""
        turns, count = 3, len(self.components)
        turned = self.T_antenna_sensor.retract(np.append(step[:turns], np.zeros(3)))
        gain, offset = self.gain + step[turns : turns + count], self.offset + step[turns + count :]
        return replace(self, T_antenna_sensor=turned, gain=gain, offset=offset)

    @cached_property
    def axes(self) -> np.ndarray:
        """(6, 6) matrix from force and moment about the antenna's origin to the components in the order of
        `READINGS`."""
        return _by_wrench(self.T_antenna_sensor.rotation, self.T_antenna_sensor.translation_m)

    @cached_property
    def turns(self) -> np.ndarray:
        """(3, 6, 6) derivatives of `axes` by the sensor's rotation about the antenna's axes."""
        pose = self.T_antenna_sensor
        return np.stack([_by_wrench(np.cross(axis, pose.rotation.T).T, pose.translation_m) for axis in np.eye(3)])

    def slopes(self, gain_y: float) -> np.ndarray:
        """(W, 6, 7) derivatives by its own parameters of the matrix from force, moment and 1 to the readings; gain_y
        : of the rig's moment sensor, 0 without one."""
        count, of = len(self.components), [list(READINGS).index(name) for name in self.components]
        slopes = np.zeros((3 + 2 * count, len(READINGS), 7))
        gains = np.zeros(len(READINGS))
        gains[of], gains[0] = self.gain, -gain_y
        slopes[:3, :, :6] = gains[:, None] * self.turns
        for row, reading in enumerate(of, 3):
            slopes[row, reading, :6] = self.axes[reading]
            slopes[row + count, reading, 6] = 1.0
        return slopes if len(self.covariance) else slopes[:0]

    def to_dict(self) -> dict[str, Any]:
        """The entry `wrench_sensor` of rig.json."""
        numbers = {name: getattr(self, name).tolist() for name in ("gain", "offset", "std")}
        deviations = np.sqrt(np.clip(np.diag(self.own_covariance), 0.0, None)).tolist()
        return {
            "components": list(self.components),
            **numbers,
            "T_antenna_sensor": self.T_antenna_sensor.to_dict(),
            "parameters_std": dict(zip(self.parameter_names, deviations, strict=True)),
            "covariance": self.covariance.tolist(),
        }


def _by_wrench(rotation: np.ndarray, origin_m: np.ndarray) -> np.ndarray:
    """(6, 6) matrix from force and moment about the antenna's origin to the components, in the order of `READINGS`,
    about another origin and along the columns of a rotation."""
    x, y, z = origin_m
    moved = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    whole = np.block([[rotation.T, np.zeros((3, 3))], [-rotation.T @ moved, rotation.T]])
    return whole[[3 * (name[0] == "m") + "xyz".index(name[1]) for name in READINGS]]
