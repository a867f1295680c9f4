"""What rig.json says of itself: is plane C known well enough, the lens whole, EI plausible; and what was doubted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vbaa_calib.calibrate.lens.uncertainty import pixel_grid, projection_uncertainty
from vbaa_calib.calibrate.pose.board_pose import AMBIGUOUS
from vbaa_calib.rig import POSE_PARAMETERS, Rig

from .finding import FAILS, HOLDS, LOOK, NOT_GIVEN, Finding

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


PLANE_LOOK_MM, PLANE_FAIL_MM = 0.2, 1.0
STIFFNESS_LOOK, STIFFNESS_FAIL = 0.01, 0.05
NOMINAL_LOOK = 0.15
GAIN_LOOK, GAIN_FAIL = 0.02, 0.1


def number_at(data: Mapping[str, Any], *keys: str) -> float | None:
    """A finite number at a path of keys; None where it is not recorded, or is no number."""
    return finite(_at(data, keys))


def finite(value: Any) -> float | None:
    """A recorded value as a finite number; None where it is none."""
    usable = isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))
    return float(value) if usable else None


def _texts_at(data: Mapping[str, Any], *keys: str) -> list[str]:
    """A list of texts at a path of keys; empty where it is not recorded."""
    value = _at(data, keys)
    return [str(line) for line in value] if isinstance(value, list) else []


def _at(data: Mapping[str, Any], keys: Sequence[str]) -> Any:
    value: Any = data
    for key in keys:
        value = value.get(key) if isinstance(value, Mapping) else None
    return value


def rig_numbers(rig: Rig, nominal_Nm2: float | None) -> dict[str, Any]:
    """Camera, lens, antenna (its EI beside the nominal one, where that is known) and sensor, with deviations."""
    camera, antenna, sensor = rig.camera, rig.antenna, rig.moment_sensor
    lens = camera.parameters
    lens_std = None if camera.covariance is None else np.sqrt(np.diag(camera.covariance).clip(0.0)).tolist()
    pose_std = [rig.std(name) for name in POSE_PARAMETERS]
    region = camera.valid_region()
    shape = zip(
        ("clamp_y_m", "clamp_z_m", "clamp_about_y_rad", "clamp_about_z_rad", "bow_about_y_per_m", "bow_about_z_per_m"),
        antenna.parameters[:6].tolist(),
        strict=True,
    )
    return {
        "lens": {
            "model": camera.model,
            "image_size": list(camera.image_size),
            "parameters": list(camera.parameter_names),
            "values": lens.tolist(),
            "std": lens_std,
            "image_fraction": region.image_fraction,
            "half_angle_rad": region.half_angle_rad,
        },
        "camera_pose": {
            "translation_m": rig.T_antenna_camera.translation_m.tolist(),
            "translation_std_m": pose_std[3:],
            "view_axis": rig.T_antenna_camera.rotation[:, 2].tolist(),
            "rotation_std_rad": pose_std[:3],
        },
        "antenna": {
            "length_m": antenna.length_m,
            "diameter_m": antenna.diameter_m,
            "stiffness_Nm2": antenna.stiffness_Nm2,
            "stiffness_std_Nm2": antenna.stiffness_Nm2 * rig.std("log_stiffness_Nm2"),
            "nominal_stiffness_Nm2": nominal_Nm2,
            "mass_per_length_kg_m": antenna.mass_per_length_kg_m,
            "mass_per_length_std_kg_m": antenna.mass_per_length_kg_m * rig.std("log_mass_per_length_kg_m"),
            "free_shape": [{"name": name, "value": value, "std": rig.std(name)} for name, value in shape],
        },
        "moment_sensor": {
            "gain": sensor.gain,
            "gain_std": rig.std("moment_gain"),
            "offset_Nm": sensor.offset_Nm,
            "offset_std_Nm": rig.std("moment_offset_Nm"),
            "std_Nm": sensor.std_Nm,
        },
    }


def rig_findings(
    rig: Rig, quality: Mapping[str, Any], plane: PictureMap, along: AlongAntenna, nominal_Nm2: float | None
) -> list[Finding]:
    """The questions that rig.json answers by itself."""
    return [
        _plane_c(rig, along),
        _lens_whole(rig, plane),
        _stiffness(rig, nominal_Nm2),
        _sensor(rig),
        _ambiguity(quality),
        _recorded(quality),
    ]


def _graded(value: float, look: float, fail: float) -> str:
    return HOLDS if value <= look else LOOK if value <= fail else FAILS


def _plane_c(rig: Rig, along: AlongAntenna) -> Finding:
    name, question = "plane_c", "How well is a point on plane C known?"
    if rig.camera.covariance is None:
        words = "the lens has no covariance in rig.json: what it adds on plane C is not known"
        return Finding(name, question, LOOK, words, "calibrate again with vbaa calibrate")
    seen = np.isfinite(along.std_m)
    if not seen.any():
        words = "the camera does not see the antenna's axis"
        return Finding(name, question, FAILS, words, "turn the camera to the antenna, then calibrate again")
    worst = 1e3 * float(along.std_m[seen].max())
    words = f"to {worst:.3f} mm (1 std, worst direction) or better along the antenna"
    level = _graded(worst, PLANE_LOOK_MM, PLANE_FAIL_MM)
    if not seen.all():
        level = max(level, LOOK, key=(HOLDS, LOOK, FAILS).index)
        words += f"; {int((~seen).sum())} of {len(seen)} places along it are outside the picture"
    remedy = None if level == HOLDS else _to_know_better(rig)
    return Finding(name, question, level, words, remedy)


def _to_know_better(rig: Rig) -> str:
    """What limits plane C most: how the camera stands, as the jig and the print have it, or the lens."""
    turned_mm = (
        1e3
        * float(np.sqrt(np.diag(rig.covariance)[:3].max()))
        * float(np.linalg.norm(rig.T_antenna_camera.translation_m))
    )
    placed_mm = 1e3 * float(np.sqrt(np.diag(rig.covariance)[3:6].max()))
    if max(turned_mm, placed_mm) > PLANE_LOOK_MM / 2:
        return "know the jig's place and angles, and the print's size, better, or take a sweep of the joints besides"
    return "add pictures of the board near the antenna, tilted by 30 to 45 degrees"


def _lens_whole(rig: Rig, plane: PictureMap) -> Finding:
    name, question = "lens_region", "Does every pixel have one ray?"
    share = rig.camera.valid_region().image_fraction
    if share == 1.0:
        return Finding(name, question, HOLDS, "the lens maps the whole picture one to one")
    rays = np.asarray(rig.camera.unproject(plane.pixels)[1])
    words = (
        f"in {100 * share:.1f} % of the picture; the rest gives no answer ({int((~rays).sum())} of {rays.size} spots)"
    )
    return Finding(name, question, LOOK, words, "add views of the board near the picture's border, calibrate again")


def _stiffness(rig: Rig, nominal_Nm2: float | None) -> Finding:
    name, question = "stiffness_known", "Is EI known, and plausible?"
    relative = rig.std("log_stiffness_Nm2")
    level = _graded(relative, STIFFNESS_LOOK, STIFFNESS_FAIL)
    remedy = None if level == HOLDS else "add known loads, heavier or further out"
    words = f"EI = {rig.antenna.stiffness_Nm2:.5g} N·m² ± {100 * relative:.2g} %"
    if nominal_Nm2 is None or nominal_Nm2 <= 0:
        return Finding(name, question, level, words + "; the nominal E·πd⁴/64 is not recorded", remedy)
    off = rig.antenna.stiffness_Nm2 / nominal_Nm2 - 1
    words += f", {100 * off:+.1f} % from E·πd⁴/64 = {nominal_Nm2:.4g} N·m²"
    if abs(off) > max(NOMINAL_LOOK, 3 * relative):
        level = max(level, LOOK, key=(HOLDS, LOOK, FAILS).index)
        remedy = "check the antenna's diameter, the loads and their unit"
    return Finding(name, question, level, words, remedy)


def _sensor(rig: Rig) -> Finding:
    name, question = "sensor_known", "Is the moment sensor known?"
    sensor, std = rig.moment_sensor, rig.std("moment_gain")
    words = (
        f"gain {sensor.gain:.4f} ± {std:.2g}, offset {1e3 * sensor.offset_Nm:.3f} ± "
        f"{1e3 * rig.std('moment_offset_Nm'):.2g} mN·m"
    )
    if sensor.gain <= 0:
        return Finding(name, question, FAILS, words, "its sign is turned round: check the wiring, calibrate again")
    level = _graded(std / sensor.gain, GAIN_LOOK, GAIN_FAIL)
    remedy = None if level == HOLDS else "add known loads that leave plane C (force_z_N)"
    return Finding(name, question, level, words, remedy)


def _ambiguity(quality: Mapping[str, Any]) -> Finding:
    name, question = "planar_ambiguity", "Could the board in the jig have been read the other way round?"
    ratio = number_at(quality, "plane_second_solution_ratio")
    if ratio is None:
        if number_at(quality, "plane_rms_px") is None:
            return Finding(name, question, NOT_GIVEN, "not recorded")
        return Finding(name, question, HOLDS, "a plane's second pose does not exist here")
    words = f"its second pose fits {ratio:.1f} times worse"
    if ratio >= AMBIGUOUS:
        return Finding(name, question, HOLDS, words)
    return Finding(name, question, LOOK, words, "take the board in the jig from a steeper angle, calibrate again")


def _recorded(quality: Mapping[str, Any]) -> Finding:
    name, question = "doubts", "Did the calibration have doubts of its own?"
    if not quality:
        return Finding(name, question, NOT_GIVEN, "not recorded")
    lines = [*_texts_at(quality, "warnings"), *_texts_at(quality, "lens", "warnings")]
    if not lines:
        return Finding(name, question, HOLDS, "none")
    return Finding(name, question, LOOK, "; ".join(lines), "do what they say, then calibrate again")
