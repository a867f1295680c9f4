"""The antenna as a thin painted tube: its picture is exact to a few thousandths of a pixel across the axis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vbaa_calib.native import core
from vbaa_calib.simulate.scene.lens import Lens, project

from .picture import ImagePatch, Studio, frame_around
from .settings import PAINT

DepthOfObstacle = Callable[[np.ndarray], np.ndarray]
"""Pixels (N, 2) to the depth (N,) along the camera's z of whatever may stand in front; inf where nothing does."""


@dataclass(frozen=True, eq=False)
class Tube:
    """A tube in the camera frame, sampled at least twice a pixel.

    Attributes
    ----------
    pixels : (N, 2) the middle between its edges, which are where rays touch it.
    tangents, normals : (N, 2) unit vectors in the picture, along and across.
    half_width_px : (N,) half the width of its silhouette.
    depth_m : (N,) depth of the centreline along the camera's z.
    facing : (N,) how squarely it lies to the lamp, 0 to 1.
    """

    pixels: np.ndarray
    tangents: np.ndarray
    normals: np.ndarray
    half_width_px: np.ndarray
    depth_m: np.ndarray
    facing: np.ndarray


def tube(
    lens: Lens,
    arclength_m: np.ndarray,
    points_camera_m: np.ndarray,
    radius_m: np.ndarray | float,
    lamp_camera: np.ndarray,
) -> Tube:
    """The tube of radius () or (n,) around a curve with arc lengths (n,) and points (n, 3), camera frame, in front
    of the camera."""
    even = np.linspace(arclength_m[0], arclength_m[-1], 200)
    rough = project(lens, core.simulate.spline(arclength_m, points_camera_m, even)[0])
    # two for every pixel; near the camera's plane it would be longer than anything in the picture
    along_px = np.linalg.norm(np.diff(rough, axis=0), axis=1).sum()
    count = int(np.ceil(2 * min(along_px, 10.0 * sum(lens.image_size)))) + 2
    s = np.linspace(arclength_m[0], arclength_m[-1], count)
    points, along = core.simulate.spline(arclength_m, points_camera_m, s)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along, points)
    thick = np.interp(s, arclength_m, np.broadcast_to(radius_m, len(arclength_m)))[:, None]
    side *= thick / np.linalg.norm(side, axis=1, keepdims=True)
    towards = (points * along).sum(axis=1, keepdims=True) * along - points
    part = thick**2 / (towards**2).sum(axis=1, keepdims=True)
    touched = [project(lens, points + part * towards + sign * np.sqrt(1.0 - part) * side) for sign in (1.0, -1.0)]
    pixels, across = (touched[0] + touched[1]) / 2, (touched[0] - touched[1]) / 2
    tangents = np.gradient(pixels, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    normals = np.stack([-tangents[:, 1], tangents[:, 0]], axis=1)
    return Tube(
        pixels=pixels,
        tangents=tangents,
        normals=normals,
        half_width_px=np.abs((across * normals).sum(axis=1)),
        depth_m=points[:, 2],
        facing=np.sqrt(np.maximum(1.0 - (along @ lamp_camera) ** 2, 0.0)),
    )


def tube_patch(
    place: Studio, seen: Tube, paint: float, asymmetry: float = 0.0, obstacle: DepthOfObstacle | None = None
) -> ImagePatch | None:
    """The tube's picture, covered where the obstacle is nearer to the camera; None outside the picture.

    Parameters
    ----------
    paint : albedo, 0 to 1.
    asymmetry : how much brighter one flank is; with 0 the centroid across the tube lies on the axis.
    """
    steps = (np.arange(PAINT.antenna_subpixels) + 0.5) / PAINT.antenna_subpixels - 0.5
    inner = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    curve = np.column_stack([seen.pixels, seen.tangents, seen.normals, seen.half_width_px])
    size = place.rays.lens.image_size
    found = core.simulate.tube_pixels(curve, *size, inner, PAINT.antenna_subpixels, asymmetry)
    rows, columns, nearest, coverage, shade = found
    if not rows.size:
        return None
    centres = np.stack([columns, rows], axis=1).astype(float)
    if obstacle is not None:
        which, sample = np.nonzero(coverage)
        hidden = obstacle(centres[which] + inner[sample]) < seen.depth_m[nearest[which]]
        coverage[which[hidden], sample[hidden]] = shade[which[hidden], sample[hidden]] = 0.0
    light = paint * (0.7 + 0.3 * seen.facing[nearest])

    left, top, right, bottom = frame_around(place, centres)

    def laid_out(values: np.ndarray) -> np.ndarray:
        fine = np.zeros((bottom - top, PAINT.antenna_subpixels, right - left, PAINT.antenna_subpixels), np.float32)
        fine[rows - top, :, columns - left, :] = values.reshape(-1, PAINT.antenna_subpixels, PAINT.antenna_subpixels)
        return fine.reshape((bottom - top) * PAINT.antenna_subpixels, (right - left) * PAINT.antenna_subpixels)

    return ImagePatch(left, top, PAINT.antenna_subpixels, laid_out(light[:, None] * shade), laid_out(coverage))


def visible_centreline(lens: Lens, seen: Tube, obstacle: DepthOfObstacle | None, step_px: float = 1.0) -> np.ndarray:
    """(M, 4) u, v and unit normal, about every `step_px`, of the visible centreline."""
    stride = max(1, round(2 * step_px))
    keep = np.arange(0, len(seen.pixels), stride)
    pixels = seen.pixels[keep]
    in_sight = visible(lens, pixels, seen.depth_m[keep], obstacle)
    return np.concatenate([pixels, seen.normals[keep]], axis=1)[in_sight]


def visible(lens: Lens, pixels: np.ndarray, depth_m: np.ndarray, obstacle: DepthOfObstacle | None) -> np.ndarray:
    """(N,) mask of the points at pixels (N, 2) and depths (N,) that are in the picture and in front of the obstacle."""
    inside = np.all((pixels >= 0) & (pixels <= np.array(lens.image_size) - 1), axis=1)
    if obstacle is None:
        return np.asarray(inside)
    return inside & (obstacle(np.where(inside[:, None], pixels, 0.0)) >= depth_m)
