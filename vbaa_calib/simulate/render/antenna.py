"""The antenna as a thin painted tube: its picture is exact to a few thousandths of a pixel across the axis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vbaa_calib.native import core
from vbaa_calib.simulate.scene.lens import Lens, project

from .picture import ImagePatch, Studio
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

    @staticmethod
    def lit(facing: np.ndarray) -> np.ndarray:
        """The part of its paint's brightness that a tube has which lies so squarely to the lamp."""
        return 0.7 + 0.3 * facing


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
    # a spline through every eighth is the same to 1e-5 px
    s, nodes = (np.linspace(arclength_m[0], arclength_m[-1], number) for number in (count, count // 8 + 4))
    points, along = core.simulate.spline(arclength_m, points_camera_m, nodes)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along, points)
    thick = np.interp(nodes, arclength_m, np.broadcast_to(radius_m, len(arclength_m)))[:, None]
    side *= thick / np.linalg.norm(side, axis=1, keepdims=True)
    towards = (points * along).sum(axis=1, keepdims=True) * along - points
    part = thick**2 / (towards**2).sum(axis=1, keepdims=True)
    inwards, outwards = points + part * towards, np.sqrt(1.0 - part) * side
    one, other = project(lens, np.stack([inwards + outwards, inwards - outwards]))
    facing = np.sqrt(np.maximum(1.0 - (along @ lamp_camera) ** 2, 0.0))
    columns = np.column_stack([(one + other) / 2, (one - other) / 2, points[:, 2], facing])
    found, slopes = core.simulate.spline(nodes, columns, s)
    tangents = slopes[:, :2] / np.linalg.norm(slopes[:, :2], axis=1, keepdims=True)
    normals = np.stack([-tangents[:, 1], tangents[:, 0]], axis=1)
    return Tube(
        pixels=found[:, :2],
        tangents=tangents,
        normals=normals,
        half_width_px=np.abs((found[:, 2:4] * normals).sum(axis=1)),
        depth_m=found[:, 4],
        facing=found[:, 5],
    )


def tube_patches(
    place: Studio, seen: Tube, paint: float, asymmetry: float = 0.0, obstacle: DepthOfObstacle | None = None
) -> list[ImagePatch]:
    """The tube's picture, stretch by stretch, covered where the obstacle is nearer to the camera.

    Parameters
    ----------
    paint : albedo, 0 to 1.
    asymmetry : how much brighter one flank is; with 0 the centroid across the tube lies on the axis.
    """
    numbers = (seen.pixels, seen.tangents, seen.normals, seen.half_width_px, paint * Tube.lit(seen.facing))
    curve, factor = np.column_stack([*numbers, seen.depth_m]), PAINT.antenna_subpixels
    size = place.rays.lens.image_size
    found = core.simulate.tube_parts(curve, size, place.room_px, factor, asymmetry)
    if obstacle is not None:
        nearest = obstacle(np.concatenate([np.zeros((0, 2)), *(at[:, :2] for *_, at in found)]))
        for _, _, fine, covered, at in found:
            hidden = nearest[: len(at)] < at[:, 2]
            fine.reshape(2, -1)[:, covered[hidden]], nearest = 0.0, nearest[len(at) :]
    return [ImagePatch(left, top, factor, *fine) for left, top, fine, *_ in found]


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
