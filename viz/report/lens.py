"""The page of `vbaa intrinsics`: the verdict, coverage and uncertainty of the lens, each view, a sample picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from markupsafe import Markup

from targets.board import Board
from vbaa_calib.calibrate.lens.board_shape import BoardShape
from vbaa_calib.calibrate.lens.intrinsics import LensSolution
from vbaa_calib.calibrate.lens.uncertainty import projection_uncertainty
from vbaa_calib.camera import Camera
from vbaa_calib.core.images import read_picture
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.diagnose.boards import same_pose
from vbaa_calib.geometry.covariance import largest_std
from viz.figures import check as figures
from viz.figures.settings import STYLE
from viz.pages.page import Table, fixed, number, records, render, with_std

from .check import DROPPED, LENSES, lens_rows
from .make import packed

_WIDEST = 2.5
"""Of the undistorted sample, from its axis, over the focal length: 68°; beyond, it is mostly stretched."""


def page(
    solution: LensSolution, views: Sequence[BoardView], spec: Board, document: Mapping[str, Any], folder: Path
) -> str:
    """The page as HTML. views : of all pictures of the `folder`. document : camera.json."""
    camera = solution.camera
    rows = _residuals(solution, views)
    distance_m = float(np.median([one.T_camera_board.translation_m[2] for one in solution.views]))
    of_plane, of_projection = _maps(camera, distance_m)
    size = camera.image_size
    drawn = [
        figures.heat_map(f"at {distance_m:.2g} m, mm", of_plane, size),
        figures.heat_map("of the projection, px", of_projection, size),
    ]
    over = [
        figures.residual_arrows(rows, size),
        figures.coverage(rows, size),
        figures.residuals_by_radius(rows, camera.parameters[2:4].tolist()),
        figures.views_rms(rows, None),
    ]
    parameters = lens_rows(camera.parameter_names, camera.parameters, document["std"].values())
    sample = max(rows, key=lambda row: np.ptp(row["corners_px"], axis=0).prod())["name"]
    return render(
        "lens.html.j2",
        title=str(folder),
        colour={"trusted": STYLE.teal, "look at": STYLE.amber, "do not use": STYLE.red}[solution.grade],
        headline=solution.headline,
        colours={True: STYLE.red, False: STYLE.amber},
        solution=solution,
        distance_m=distance_m,
        maps=[axes.svg() for axes in drawn],
        over=[axes.svg() for axes in over],
        sample=sample,
        pictures=[packed(one) for one in _straightened(camera, read_picture(folder / sample))],
        parameters=Table(("what", "value", "unit"), parameters, ("what",)),
        views=_views(solution, views, spec),
        dropped=records(document["dropped"], DROPPED, 2),
        board=_board(solution.board_shape),
        models=records(document["model_comparison"], LENSES),
    )


def _residuals(solution: LensSolution, views: Sequence[BoardView]) -> list[dict[str, Any]]:
    """Corners and their residuals, view by view, in the form that the figures of boards take."""
    seen, points_m = {view.name: view for view in views}, solution.board_shape.points_m
    rows = []
    for used in solution.views:
        view = seen[used.name]
        predicted, there = solution.camera.project(used.T_camera_board @ points_m[view.ids])
        rows.append(
            {
                "name": used.name,
                "folder": "intrinsics",
                "rms_px": used.rms_px,
                "corners_px": view.corners_px[there],
                "residuals_px": (view.corners_px - predicted)[there],
                "good": ~np.isin(view.ids, used.outlier_ids)[there],
            }
        )
    return rows


def _maps(camera: Camera, distance_m: float) -> tuple[dict[str, Any], dict[str, Any]]:
    """Maps of worst-direction standard deviations over the picture: on a plane across the axis, mm, and in the
    picture, px."""
    pixels, covariance_px2, std_px = projection_uncertainty(camera, grid=(49, 37))
    _, slopes, seen = camera.normalized_with_slopes(pixels)
    slopes = 1e3 * distance_m * np.where(seen[..., None, None], slopes, np.nan)
    std_mm = largest_std(slopes @ covariance_px2 @ np.swapaxes(slopes, -1, -2))
    place = {"columns_px": pixels[0, :, 0], "rows_px": pixels[:, 0, 1], "has_ray": seen}
    return {"unit": "mm", "std": std_mm, **place}, {"unit": "px", "std": std_px, **place}


def _straightened(camera: Camera, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The picture, and the same resampled through a lens of the same width without distortion."""
    width, height = camera.image_size
    edge = np.concatenate(
        [np.column_stack([np.arange(width), np.full(width, row)]) for row in (0, height - 1)]
        + [np.column_stack([np.full(height, column), np.arange(height)]) for column in (0, width - 1)]
    )
    ideal, seen = camera.unproject_normalized(edge.astype(float))
    ideal = np.clip(np.where(seen[:, None], ideal, _WIDEST * np.sign(edge - camera.matrix[:2, 2])), -_WIDEST, _WIDEST)
    low, high = ideal.min(axis=0), ideal.max(axis=0)
    tall = max(round(width * (high[1] - low[1]) / (high[0] - low[0])), 1)
    x, y = np.meshgrid(np.linspace(low[0], high[0], width), np.linspace(low[1], high[1], tall))
    pixels, there = camera.project(np.stack([x, y, np.ones_like(x)], axis=-1))
    u, v = np.moveaxis(np.where(there[..., None], pixels, -1.0).astype(np.float32), -1, 0)
    return image, cv2.remap(image, u, v, cv2.INTER_LINEAR, borderValue=(255, 255, 255))


def _board(shape: BoardShape) -> Table:
    """The board's deviations from a flat print with square squares."""
    scales = {"mm": 1e3, "%": 1e2, "mrad": 1e3}
    rows = [
        [words, with_std(float(value), float(std), scales[unit]), unit]
        for (words, unit), value, std in zip(
            (("bow along x", "mm"), ("bow along y", "mm"), ("twist", "mm"), ("longer along x", "%"), ("shear", "mrad")),
            shape.parameters,
            shape.std,
            strict=True,
        )
    ]
    return Table(("what", "value", "unit"), rows, ("what",))


def _views(solution: LensSolution, views: Sequence[BoardView], spec: Board) -> Table:
    """Each view that was used, with its faults."""
    seen, rows = {view.name: view for view in views}, []
    for index, used in enumerate(solution.views):
        again = same_pose(seen[used.name], [seen[one.name] for one in solution.views[:index]], spec)
        tilt_deg = np.degrees(np.arccos(np.clip(abs(used.T_camera_board.rotation[2, 2]), 0.0, 1.0)))
        ids = ", ".join(map(str, used.outlier_ids[:12])) + (" …" if len(used.outlier_ids) > 12 else "")
        faults = ["its residuals stand out"] if used.outlying else []
        faults += [f"outlying corners: {ids}"] if used.left_out else []
        faults += [again.words] if again is not None else []
        numbers = [str(used.corners), fixed(used.rms_px, 3), fixed(float(tilt_deg), 0)]
        away = number(float(used.T_camera_board.translation_m[2]), 3)
        rows.append(
            [used.name, *numbers, away, Markup('<span class="long">{}</span>').format("; ".join(faults) or "–")]
        )
    head = ("picture", "corners used", "rms, px", "tilt, °", "distance, m", "look at")
    return Table(head, rows, ("picture", "look at"))
