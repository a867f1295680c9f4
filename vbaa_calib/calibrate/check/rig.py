"""A rig by itself: uncertainty on plane C, region of the lens, plausibility of EI, doubts of the calibration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vbaa_calib.antenna.shape import PARAMETERS as ANTENNA_PARAMETERS
from vbaa_calib.calibrate.lens.uncertainty import pixel_grid, projection_uncertainty
from vbaa_calib.calibrate.pose.settings import PoseSettings
from vbaa_calib.geometry.independent_axes import largest_std
from vbaa_calib.rig import POSE_PARAMETERS, Rig

from .finding import FAILS, HOLDS, LOOK, NOT_GIVEN, Finding
from .settings import CheckSettings


def rig_maps(rig: Rig) -> dict[str, Any]:
    """Maps for check.json: standard deviations of the projection, a turn of the camera taken out, and on plane C."""
    camera, projection = rig.camera, None
    if camera.covariance is not None:
        pixels, _, std_px = projection_uncertainty(camera, compensated=True, grid=CheckSettings.map_grid)
        projection = _map_document(pixels, std_px, "px")
    pixels, std_mm = _plane_map(rig)
    along = zip(*_along(rig), strict=True)
    return {
        "projection": projection,
        "plane": _map_document(pixels, std_mm, "mm"),
        "has_ray": np.asarray(camera.unproject(pixels)[1]).tolist(),
        "along_antenna": [
            {"arclength_m": float(s), "u_px": _rounded(u), "v_px": _rounded(v), "std_mm": _rounded(1e3 * std)}
            for s, (u, v), std in along
        ],
    }


def _plane_map(rig: Rig) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (R, C, 2), worst deviation (R, C), mm, of the point on plane C that each shows; NaN out of reach."""
    pixels = pixel_grid(rig.camera.image_size, CheckSettings.map_grid)
    points, seen = rig.on_plane_C(pixels)
    near = seen & (np.linalg.norm(np.nan_to_num(points), axis=-1) <= CheckSettings.reach_lengths * rig.antenna.length_m)
    return pixels, np.where(near, 1e3 * _plane_std_m(rig, pixels), np.nan)


def _map_document(pixels: np.ndarray, std: np.ndarray, unit: str) -> dict[str, Any]:
    known = std[np.isfinite(std)]
    return {
        "unit": unit,
        "columns_px": pixels[0, :, 0].tolist(),
        "rows_px": pixels[:, 0, 1].tolist(),
        "std": [[_rounded(value) for value in row] for row in std.tolist()],
        "median": float(np.median(known)) if len(known) else None,
        "largest": float(known.max()) if len(known) else None,
    }


def _along(rig: Rig) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Arc lengths (S,) m, pixels (S, 2) of the antenna's axis there, NaN outside the picture, and deviation (S,) m."""
    s = rig.antenna.length_m * np.array(CheckSettings.along)
    pixels, seen = rig.camera.project(rig.T_antenna_camera.inverse() @ (s[:, None] * np.array([1.0, 0.0, 0.0])))
    inside = seen & rig.camera.in_picture(pixels)
    std = np.full(len(s), np.nan)
    std[inside] = _plane_std_m(rig, pixels[inside])
    return s, np.where(inside[:, None], pixels, np.nan), std


def _plane_std_m(rig: Rig, pixels: np.ndarray) -> np.ndarray:
    jacobian = rig.plane_C_jacobian(pixels)
    return largest_std(jacobian @ rig.plane_covariance() @ np.swapaxes(jacobian, -1, -2))


def _rounded(value: float) -> float | None:
    return float(f"{value:.4g}") if np.isfinite(value) else None


def number_at(data: Any, *keys: str) -> float | None:
    """A finite number at a path of keys; None where it is not recorded, or is no number."""
    value = at(data, *keys)
    usable = isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))
    return float(value) if usable else None


def at(data: Any, *keys: str) -> Any:
    """Value at a path of keys; None where something else is on the way."""
    for key in keys:
        data = data.get(key) if isinstance(data, Mapping) else None
    return data


def rig_numbers(rig: Rig, nominal_Nm2: float | None) -> dict[str, Any]:
    """Camera, lens, antenna (EI and the nominal one, where that is known) and sensor, with deviations."""
    camera, antenna, sensor = rig.camera, rig.antenna, rig.moment_sensor
    lens_std = None if camera.covariance is None else np.sqrt(np.diag(camera.covariance).clip(0.0)).tolist()
    pose_std = [rig.std(name) for name in POSE_PARAMETERS]
    region = camera.valid_region()
    shape = zip(ANTENNA_PARAMETERS[:6], antenna.parameters[:6].tolist(), strict=True)
    return {
        "lens": {
            "model": camera.model,
            "image_size": list(camera.image_size),
            "parameters": list(camera.parameter_names),
            "values": camera.parameters.tolist(),
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
        }
        if sensor.exists
        else None,
    }


def rig_findings(rig: Rig, quality: Mapping[str, Any], nominal_Nm2: float | None) -> list[Finding]:
    """The questions that rig.json answers by itself."""
    # the calibration repeats what its lens' verdict says
    lines = dict.fromkeys(line for at_ in ((), ("lens",)) for line in _listed(at(quality, *at_, "warnings")))
    remedy = "do what they say, then calibrate again"
    wrong = rig.verdict.severity == "wrong" or at(quality, "lens", "grade") == "do not use"
    limits = (0, 0 if wrong else np.inf)
    doubts = _graded("doubts", len(lines), limits, "; ".join(lines) or "none", remedy)
    doubts = doubts if quality else Finding("doubts", NOT_GIVEN, "not recorded")
    name, ratio = "planar_ambiguity", number_at(quality, "plane_second_solution_ratio")
    if ratio is not None:
        remedy = "take the board in the jig from a steeper angle, calibrate again"
        words = f"its second pose fits {ratio:.1f} times worse"
        second = _graded(name, -ratio, (-PoseSettings.ambiguous, np.inf), words, remedy)
    elif number_at(quality, "plane_rms_px") is None:
        second = Finding(name, NOT_GIVEN, "not recorded")
    else:
        second = Finding(name, HOLDS, "no: only one pose of the board fits the picture")
    sensor = [_sensor(rig)] if rig.moment_sensor.exists else []
    return [_plane_c(rig), _lens_region(rig), _stiffness(rig, nominal_Nm2), *sensor, second, doubts]


def _listed(found: Any) -> list[str]:
    return [str(line) for line in found] if isinstance(found, list) else []


def _graded(name: str, value: float, limits: tuple[float, float], words: str, remedy: str) -> Finding:
    """A finding from a deviation and the limits from which it is `LOOK` and `FAILS`."""
    look, fail = limits
    level = HOLDS if value <= look else LOOK if value <= fail else FAILS
    return Finding(name, level, words, None if level == HOLDS else remedy)


def _plane_c(rig: Rig) -> Finding:
    if rig.camera.covariance is None:
        words = "the lens has no covariance in rig.json: its share of the uncertainty on plane C is not known"
        return Finding("plane_c", LOOK, words, "calibrate again with vbaa calibrate")
    *_, std_m = _along(rig)
    seen = np.isfinite(std_m)
    if not seen.any():
        words = "the camera does not see the antenna's axis"
        return Finding("plane_c", FAILS, words, "turn the camera to the antenna, then calibrate again")
    largest_mm = 1e3 * float(std_m[seen].max())
    std = np.sqrt(np.diag(rig.covariance)[:6])
    turned_m = float(std[:3].max()) * float(np.linalg.norm(rig.T_antenna_camera.translation_m))
    remedy = "add pictures of the board near the antenna, tilted by 30 to 45 degrees"
    if 1e3 * max(turned_m, float(std[3:].max())) > CheckSettings.plane_look_mm / 2:
        remedy = "know the jig's place and angles, and the print's size, better, or take a sweep of the joints besides"
    words = f"to {largest_mm:.3f} mm (1 std, worst direction) or better along the antenna"
    found = _graded("plane_c", largest_mm, (CheckSettings.plane_look_mm, CheckSettings.plane_fail_mm), words, remedy)
    if seen.all():
        return found
    words += f"; {int((~seen).sum())} of {len(seen)} places along it are outside the picture"
    return Finding("plane_c", found.level if found.is_bad else LOOK, words, remedy)


def _lens_region(rig: Rig) -> Finding:
    share = rig.camera.valid_region().image_fraction
    if share == 1.0:
        return Finding("lens_region", HOLDS, "the lens maps the whole picture one to one")
    rays = np.asarray(rig.camera.unproject(pixel_grid(rig.camera.image_size, CheckSettings.map_grid))[1])
    words = f"in {100 * share:.1f} % of the picture; {int((~rays).sum())} of {rays.size} places in the rest have no ray"
    return Finding("lens_region", LOOK, words, "add views of the board near the picture's border, calibrate again")


def _stiffness(rig: Rig, nominal_Nm2: float | None) -> Finding:
    name, relative = "stiffness_known", rig.std("log_stiffness_Nm2")
    limits, remedy = (
        (CheckSettings.stiffness_look, CheckSettings.stiffness_fail),
        "add known loads, heavier or further out",
    )
    words = f"EI = {rig.antenna.stiffness_Nm2:.5g} N·m² ± {100 * relative:.2g} %"
    if nominal_Nm2 is None or nominal_Nm2 <= 0:
        return _graded(name, relative, limits, words + "; the nominal E·πd⁴/64 is not recorded", remedy)
    off = rig.antenna.stiffness_Nm2 / nominal_Nm2 - 1
    words += f", {100 * off:+.1f} % from E·πd⁴/64 = {nominal_Nm2:.4g} N·m²"
    found = _graded(name, relative, limits, words, remedy)
    if abs(off) > max(CheckSettings.nominal_look, 3 * relative):
        remedy = "check the antenna's diameter, the loads and their unit"
        return Finding(name, found.level if found.is_bad else LOOK, words, remedy)
    return found


def _sensor(rig: Rig) -> Finding:
    sensor, std = rig.moment_sensor, rig.std("moment_gain")
    words = (
        f"gain {sensor.gain:.4f} ± {std:.2g}, offset {1e3 * sensor.offset_Nm:.3f} ± "
        f"{1e3 * rig.std('moment_offset_Nm'):.2g} mN·m"
    )
    # a sensor of several axes reads the right-handed moment, the negative
    if sensor.gain <= 0 and rig.wrench_sensor is None:
        return Finding("sensor_known", FAILS, words, "its sign is turned round: check the wiring, calibrate again")
    remedy = "add known loads that leave plane C (force_z_N)"
    return _graded(
        "sensor_known", std / abs(sensor.gain), (CheckSettings.gain_look, CheckSettings.gain_fail), words, remedy
    )
