"""whiskers.yaml: antennas in clamps of their own under one camera, stated instead of calibrated."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from pydantic import Field

from vbaa_calib.antenna.materials import round_wire
from vbaa_calib.core.models import FileModel, Number, WholeNumber

from .drift import MovingClamp
from .settings import AnyLength, Diameter, Gravity

_Relative = Annotated[Number, Field(ge=0, le=1)]
_Side = Annotated[WholeNumber, Field(ge=16, le=100_000)]
_Curvature = Annotated[Number, Field(ge=-1000, le=1000, description="natural curvature in the picture")]


@dataclass(frozen=True)
class _StraightView:
    """A camera that looks perpendicularly at the plane in which the antennas move. An error of the scale matters;
    one of the distance hardly does."""

    image_size: tuple[_Side, _Side]
    mm_per_px: Annotated[Number, Field(gt=0, le=10, description="in the antennas' plane")]
    distance_m: Annotated[Number, Field(ge=0.01, le=10, description="from the lens to that plane")]
    scale_std: Annotated[_Relative, Field(description="how well mm_per_px is known, relative")] = 0.005
    distortion: list[Number] = field(default_factory=list)

    @property
    def focal_px(self) -> float:
        """Focal length, px, that gives this scale at this distance."""
        return 1e3 * self.distance_m / self.mm_per_px

    @property
    def centre_px(self) -> tuple[float, float]:
        """Pixel of the picture's middle, at which the world's origin is."""
        return (self.image_size[0] - 1) / 2, (self.image_size[1] - 1) / 2


@dataclass(frozen=True)
class StatedAntenna:
    """An antenna described by its material. Its bow is estimated from the frames without contact."""

    length_m: AnyLength
    diameter_m: Diameter
    youngs_modulus_Pa: Annotated[Number, Field(ge=1e5, le=2e12)]
    density_kg_m3: Annotated[Number, Field(ge=10, le=3e4)]
    stiffness_std: Annotated[_Relative, Field(description="how well EI is known, relative")] = 0.2
    mass_std: Annotated[_Relative, Field(description="how well the weight is known, relative")] = 0.1
    bow_per_m: _Curvature = 0.0
    bow_std_per_m: Annotated[
        Number | None, Field(gt=0, le=1000, description="how well the bow is known; null: hardly, 1/length_m")
    ] = None

    @property
    def wire(self) -> tuple[float, float]:
        """EI, N·m², and mass per length, kg/m."""
        return round_wire(self.youngs_modulus_Pa, self.density_kg_m3, self.diameter_m)


class StatedFile(FileModel):
    """The content of whiskers.yaml."""

    VERSION = "vbaa.whiskers/1"
    version: Annotated[str, Field(alias="schema")]
    camera: _StraightView
    antennas: Annotated[dict[str, StatedAntenna], Field(min_length=1)]
    gravity_world: Annotated[
        Gravity, Field(description="m/s²; x runs to the right in the picture, y up, z to the camera; zero: weightless")
    ] = Field(default_factory=lambda: np.array([0.0, 0.0, -9.80665]))
    clamp: Annotated[MovingClamp, Field(description="what no picture shows of the clamps")] = MovingClamp()
    noise_px: Annotated[Number, Field(gt=0, le=100, description="of points whose scatter cannot be measured")] = 0.3
