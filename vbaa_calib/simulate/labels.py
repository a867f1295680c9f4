"""Labels of a session's pictures of the antenna, for training and tests; from the geometry alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from .plan import AntennaShot
from .render.antenna import tube_patch, visible
from .render.picture import Studio
from .scene.lens import project
from .scene.scene import Scene
from .shots import obstacle_of, seen_antenna


def antenna_mask(scene: Scene, place: Studio, shot: AntennaShot) -> np.ndarray:
    """(height, width) uint8, 255 times the share of each pixel that the antenna covers."""
    width, height = scene.lens.image_size
    mask = np.zeros((height, width), np.uint8)
    patch = tube_patch(place, seen_antenna(scene, shot), 1.0, obstacle=obstacle_of(scene, place, shot))
    if patch is not None:
        region = mask[patch.where]
        covered = cv2.resize(patch.alpha, region.shape[::-1], interpolation=cv2.INTER_AREA)
        region[:] = np.rint(255 * np.clip(covered, 0.0, 1.0))
    return mask


def centreline_rows(scene: Scene, place: Studio, shot: AntennaShot) -> list[dict[str, Any]]:
    """The whole centreline, about a row a pixel from clamp to tip, also where it is hidden or outside the picture."""
    seen = seen_antenna(scene, shot)
    s = np.linspace(shot.arclength_m[0], shot.arclength_m[-1], len(seen.pixels))
    shown = visible(scene.lens, seen.pixels, seen.depth_m, obstacle_of(scene, place, shot))
    numbers = np.column_stack([s, seen.pixels, seen.normals, 2 * seen.half_width_px])
    names = ("s_m", "u_px", "v_px", "normal_u", "normal_v", "width_px")
    return [
        {"image": shot.path} | dict(zip(names, np.round(row, 5).tolist(), strict=True)) | {"visible": int(one)}
        for row, one in zip(numbers[::2], shown[::2], strict=True)
    ]


def contact_row(scene: Scene, place: Studio, shot: AntennaShot, truth: Mapping[str, Any]) -> dict[str, Any]:
    """The contact in one picture, with empty cells without contact. truth : of the frame."""
    row: dict[str, Any] = dict.fromkeys(("distance_m", "u_px", "v_px", "visible", "force_y_N", "force_z_N"), "")
    if truth.get("in_contact"):
        point = scene.T_antenna_camera.inverse() @ np.array([truth["contact_antenna_m"]])
        u, v = pixel = project(scene.lens, point)[0]
        shown = visible(scene.lens, pixel[None], point[:, 2] - scene.radius_m, obstacle_of(scene, place, shot))
        where = {"distance_m": truth["distance_m"], "u_px": round(float(u), 4), "v_px": round(float(v), 4)}
        row |= where | {"visible": int(shown[0]), "force_y_N": truth["force_N"][1], "force_z_N": truth["force_N"][2]}
    return {"image": shot.path, "in_contact": int(bool(truth.get("in_contact")))} | row
