"""The parts of a rig, and their entries in rig.json."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from vbaa_calib.antenna.shape import PARAMETERS as ANTENNA_PARAMETERS
from vbaa_calib.antenna.taper import Profile, Taper, profiles_to_dict
from vbaa_calib.core.arrays import Within, as_float, fixed
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Kinematics, Pose

if TYPE_CHECKING:
    from vbaa_calib.antenna.rod import Rod
    from vbaa_calib.detect.whisker.paint import Paint

SCHEMA = "vbaa.rig/1"
POSE_PARAMETERS = (*(f"camera_about_{axis}_rad" for axis in "xyz"), *(f"camera_{axis}_m" for axis in "xyz"))
RIG_PARAMETERS = (*POSE_PARAMETERS, *ANTENNA_PARAMETERS, "moment_gain", "moment_offset_Nm")
"""Order of the joint covariance, before the lens. The pose's six are the tangent of `T_antenna_camera.retract`."""
RIG_STEPS = np.array([1e-5] * 6 + [1e-5] * 2 + [1e-4] * 2 + [1e-3] * 4 + [1e-4])
"""Finite-difference steps of pose and antenna: small against the curvature of the model, large against its rounding."""


JOINT_AXES = ("axis_skew_rad", "axis_offset_m", "tilt_zero_rad")
"""What a sweep finds of the joints, in the order of `Kinematics`."""


@dataclass(frozen=True, eq=False)
class Tip:
    """Position of the antenna's visible end.

    offset_m : how far beyond `length_m` along the antenna. std_m : its standard deviation.
    covariance : (17 + P + W,) with the parameters of the rig's joint covariance, and of its wrench sensor.
    """

    offset_m: Annotated[float, Within(ge=-1, le=1)]
    std_m: Annotated[float, Within(gt=0, le=1)]
    covariance: Annotated[np.ndarray, Within(ge=-1e12, le=1e12)]

    def __post_init__(self) -> None:
        size = np.shape(self.covariance)
        object.__setattr__(self, "covariance", fixed(self.covariance, size, "covariance of the tip", finite=False))

    def joint_with(self, covariance: np.ndarray) -> np.ndarray:
        """(18 + P + W, …) the rig's covariance (17 + P + W, …) with the tip's offset as its last parameter."""
        across = self.covariance[:, None]
        return np.block([[covariance, across], [across.T, np.array([[self.std_m**2]])]])

    def to_dict(self) -> dict[str, Any]:
        """The mapping `antenna.tip` of rig.json."""
        return {"offset_m": self.offset_m, "std_m": self.std_m, "covariance": self.covariance.tolist()}


@dataclass(frozen=True, eq=False)
class Antenna:
    """The calibrated antenna: `parameters` (9,) in the order of `antenna.shape.PARAMETERS`. Diameter, EI and mass
    per length are those at the clamp; `profile`, m, and `stiffness_profile`, in any unit, describe their change
    along the antenna."""

    length_m: float
    diameter_m: float
    parameters: np.ndarray
    profile: Profile | None = None
    stiffness_profile: Profile | None = None

    def __post_init__(self) -> None:
        """Raises InputError for lengths that are not positive, parameters that are not numbers, and invalid
        profiles."""
        for name in ("length_m", "diameter_m"):
            if not 0.0 < as_float(getattr(self, name), name, "give metres") < np.inf:
                raise InputError(f"{name} of the antenna is {getattr(self, name)}", remedy="give metres, more than 0")
        names = (len(ANTENNA_PARAMETERS),)
        object.__setattr__(self, "parameters", fixed(self.parameters, names, "parameters of the antenna", finite=False))
        _ = self.taper

    @cached_property
    def taper(self) -> Taper:
        """The antenna's taper from clamp to tip."""
        return Taper.of(self.profile, self.stiffness_profile, self.length_m)

    def radius_at(self, distance_m: np.ndarray) -> np.ndarray:
        """Half the diameter at arc lengths."""
        return 0.5 * self.diameter_m * self.taper.diameter(distance_m / self.length_m)

    @property
    def thickness(self) -> str:
        """The diameter in words."""
        thick, thin = 2e3 * self.radius_at(np.array([0.0, self.length_m]))
        stiffness = float(self.taper.stiffness(np.ones(1))[0])
        words = f"{thick:.2f} mm"
        return f"{words} (at the tip {thin:.2f} mm and {stiffness:.2g} of EI)" if self.taper else words

    @property
    def stiffness_Nm2(self) -> float:
        """EI, at the clamp."""
        return float(np.exp(self.parameters[6]))

    @property
    def mass_per_length_kg_m(self) -> float:
        """ρA, at the clamp."""
        return float(np.exp(self.parameters[7]))

    @cached_property
    def rod(self) -> Rod:
        """The antenna as a round rod with its clamping."""
        from vbaa_calib.antenna.rod import TORSION_RATIO, Rod  # loads SciPy

        y, z, about_y, about_z, bow_y, bow_z = self.parameters[:6]
        return Rod(
            length_m=self.length_m,
            bending_stiffness_Nm2=self.stiffness_Nm2,
            torsional_stiffness_Nm2=self.stiffness_Nm2 / TORSION_RATIO,
            mass_per_length_kg_m=self.mass_per_length_kg_m,
            T_antenna_clamp=Pose.from_rotvec(np.array([0.0, about_y, about_z]), np.array([0.0, y, z])),
            natural_curvature_per_m=np.array([bow_y, bow_z]),
            clamp_give_m=float(self.parameters[8]),
            taper=self.taper,
        )

    def to_dict(self, std: Callable[[str], float]) -> dict[str, Any]:
        """The entry `antenna` of rig.json. std : the standard deviation of a parameter by its name."""
        return {
            "length_m": self.length_m,
            "diameter_m": self.diameter_m,
            **profiles_to_dict(self),
            "stiffness_Nm2": self.stiffness_Nm2,
            "stiffness_std_Nm2": self.stiffness_Nm2 * std("log_stiffness_Nm2"),
            "mass_per_length_kg_m": self.mass_per_length_kg_m,
            "mass_per_length_std_kg_m": self.mass_per_length_kg_m * std("log_mass_per_length_kg_m"),
            "noload": {
                "clamp_offset_yz_m": self.parameters[0:2].tolist(),
                "clamp_rotation_yz_rad": self.parameters[2:4].tolist(),
                "bow_yz_per_m": self.parameters[4:6].tolist(),
                "clamp_give_m": float(self.parameters[8]),
            },
        }

    def stated(self, std: np.ndarray) -> dict[str, Any]:
        """Its entry of rig.json among several in the same picture. std : (9,) of its parameters."""
        by_name = dict(zip(ANTENNA_PARAMETERS, std.tolist(), strict=True))
        return self.to_dict(by_name.__getitem__) | {"parameters_std": std.tolist()}


NamedAntennas = Mapping[str, tuple[Antenna, np.ndarray]]
"""Antennas that share a camera, by name: each with the standard deviations (9,) of its parameters."""


_Weight = Annotated[float, Within(ge=-100, le=100)]
_Level = Annotated[float, Within(ge=0, le=1e6)]
_Spread = Annotated[float, Within(ge=1e-3, le=1e6)]
_Looks = Annotated[tuple[tuple[_Level, _Level, _Level, _Spread], ...], Within(min_length=8, max_length=8)]


@dataclass(frozen=True)
class AntennaImage:
    """Appearance of the antenna in this rig's pictures.

    Attributes
    ----------
    bright : whether it is brighter than the background; None: brighter in some places, darker in others.
    noise_px : typical standard deviation of one centreline point.
    noise_scale : spread of the no-load points about the solved shape over the spread that their profiles predict.
    weights_bgr, colour_bgr : of rigs calibrated before colours were seen by their edges.
    height : of the free antenna's line above its background, grey levels on the plane of `paint`; None where not
        measured.
    looks : (8, 4) its mean colour from clamp to tip, and the standard deviation of that; None: not measured.
    both_edges : whether its line is measured by both of its edges, since light from one side displaces its middle.
    """

    noise_px: Annotated[float, Within(ge=1e-6, le=1e3)]
    noise_scale: Annotated[float, Within(ge=1e-3, le=1e3)]
    bright: Annotated[
        Annotated[bool, Within()] | None,
        Within(description="brighter than its background; null: here brighter, there darker"),
    ]
    weights_bgr: Annotated[
        tuple[_Weight, _Weight, _Weight] | None, Within(description="of a colour picture's channels; null: grey level")
    ] = None
    colour_bgr: Annotated[
        tuple[_Level, _Level, _Level] | None,
        Within(description="of the antenna, grey levels, where nearness to it distinguishes antenna from background"),
    ] = None
    height: Annotated[
        Annotated[float, Within(ge=1e-6, le=1e6)] | None,
        Within(description="of the free antenna's line above its background, grey levels"),
    ] = None
    looks: Annotated[
        _Looks | None, Within(description="mean colour at places from clamp to tip and its deviation, grey levels")
    ] = None
    both_edges: Annotated[
        bool, Within(description="light from one side pulls its line, which is measured by both of its edges")
    ] = False

    def __post_init__(self) -> None:
        """Raises InputError for an impossible noise."""
        for name in ("noise_px", "noise_scale"):
            if not 0.0 < as_float(getattr(self, name), name, "give a number, more than 0") < np.inf:
                raise InputError(f"{name} is {getattr(self, name)}", remedy="give a number, more than 0")

    @property
    def paint(self) -> Paint:
        """The antenna's paint relative to its background."""
        from vbaa_calib.detect.whisker.paint import Paint  # loads the finder

        if self.weights_bgr is not None or self.colour_bgr is not None:
            return Paint(None)  # of an older calibration: any colour is seen by its edges now
        return Paint(self.bright, self.both_edges)


def kinematics_to_dict(kinematics: Kinematics) -> dict[str, Any]:
    """The entry `kinematics` of rig.json."""
    return {
        "T_actuator_antenna": kinematics.T_actuator_antenna.to_dict(),
        "position_world_m": kinematics.position_world_m.tolist(),
        **{name: getattr(kinematics, name) for name in JOINT_AXES},
        "axes_uncertainty": {
            "axes": list(JOINT_AXES),
            "std": kinematics.axes_std.tolist(),
            "by_pose": kinematics.axes_by_pose.tolist(),
        },
    }
