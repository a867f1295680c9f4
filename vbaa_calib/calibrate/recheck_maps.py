"""The rig's uncertainty over the picture: of the projection in pixels, and of a point on plane C in millimetres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..rig import Rig
from .lens_uncertainty import pixel_grid, projection_uncertainty

GRID = (49, 37)
REACH_LENGTHS = 1.5
"""How far from the clamp plane C is looked at, in lengths of the antenna: beyond that nothing can be touched."""
ALONG = (0.0, 0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True, eq=False)
class PictureMap:
    """Standard deviation in the worst direction, (R, C), over pixels (R, C, 2); NaN where there is no answer."""

    pixels: np.ndarray
    std: np.ndarray
    unit: str

    def to_dict(self) -> dict[str, Any]:
        """For check.json; None where there is no answer."""
        known = self.std[np.isfinite(self.std)]
        return {
            "unit": self.unit,
            "columns_px": self.pixels[0, :, 0].tolist(),
            "rows_px": self.pixels[:, 0, 1].tolist(),
            "std": [[_rounded(value) for value in row] for row in self.std.tolist()],
            "median": float(np.median(known)) if len(known) else None,
            "largest": float(known.max()) if len(known) else None,
        }


@dataclass(frozen=True, eq=False)
class AlongAntenna:
    """Standard deviation on plane C, in the worst direction, where the antenna's axis lies at arc lengths s."""

    arclength_m: np.ndarray
    pixels: np.ndarray
    std_m: np.ndarray

    def to_dict(self) -> list[dict[str, Any]]:
        """Rows for check.json; None where the camera does not see that point."""
        return [
            {
                "arclength_m": float(s),
                "u_px": _rounded(float(u)),
                "v_px": _rounded(float(v)),
                "std_mm": _rounded(1e3 * float(std)),
            }
            for s, (u, v), std in zip(self.arclength_m, self.pixels, self.std_m, strict=True)
        ]


def projection_map(rig: Rig) -> PictureMap | None:
    """Of the projection, what a turn of the camera explains taken out; None where the lens has no covariance."""
    if rig.camera.covariance is None:
        return None
    found = projection_uncertainty(rig.camera, compensated=True, grid=GRID)
    return PictureMap(found.pixels, found.std_px, "px")


def plane_map(rig: Rig) -> PictureMap:
    """Of the point on plane C that each pixel shows, from lens and camera pose together."""
    pixels = pixel_grid(rig.camera.image_size, GRID)
    on_plane = rig.camera_on_plane()
    points, seen = on_plane.project(pixels)
    near = seen & (np.linalg.norm(np.nan_to_num(points), axis=-1) <= REACH_LENGTHS * rig.antenna.length_m)
    std_mm = np.where(near, 1e3 * _plane_std_m(rig, pixels), np.nan)
    return PictureMap(pixels, std_mm, "mm")


def along_antenna(rig: Rig) -> AlongAntenna:
    """At some places of the antenna's axis, where the picture shows them."""
    s = rig.antenna.length_m * np.array(ALONG)
    axis = s[:, None] * np.array([1.0, 0.0, 0.0])
    pixels, seen = rig.camera.project(rig.T_antenna_camera.inverse() @ axis)
    inside = seen & rig.camera.in_picture(pixels)
    pixels = np.where(inside[:, None], pixels, np.nan)
    std = np.full(len(s), np.nan)
    std[inside] = _plane_std_m(rig, pixels[inside])
    return AlongAntenna(s, pixels, std)


def _plane_std_m(rig: Rig, pixels: np.ndarray) -> np.ndarray:
    jacobian = np.asarray(rig.camera_on_plane().calibration_jacobian(pixels))
    covariance = jacobian @ rig.plane_covariance() @ np.swapaxes(jacobian, -1, -2)
    std = np.full(covariance.shape[:-2], np.nan)
    known = np.isfinite(covariance).all(axis=(-1, -2))
    std[known] = np.sqrt(np.linalg.eigvalsh(covariance[known])[..., -1].clip(0.0))
    return std


def _rounded(value: float) -> float | None:
    return float(f"{value:.4g}") if np.isfinite(value) else None
