"""Writes the tables of benchmarks/real_sets.md: `python -m benchmarks.real_sets DATA benchmarks/real_sets.md`.

DATA is the folder that holds the sets. What is between the page's marks is replaced; the rest is kept.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.harness import markdown, replace_marked
from targets.board import BoardSpec
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.calibrate.lens.uncertainty import projection_uncertainty
from vbaa_calib.calibrate.lens_from_views import solve_lens
from vbaa_calib.camera.lens import ray_derivatives
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.images import list_images, read_gray
from vbaa_calib.detect.board.corners import BoardView, detect_corners, detect_folder

_ENDOSCOPE = BoardSpec(19, 26, 0.005, 0.004, "DICT_4X4_250", legacy_pattern=True)


@dataclass(frozen=True)
class PhotoSet:
    """A set's title, its folder in DATA, its board, and the lens model and RMS of the result that came with it."""

    title: str
    folder: str
    spec: BoardSpec
    reference_model: str
    reference_rms_px: float


SETS = (
    PhotoSet(
        "RealSense",
        "realsense_doosan_charuco/intrinsics_images",
        BoardSpec(7, 5, 0.03, 0.022, "DICT_4X4_50"),
        "opencv5",
        0.624,
    ),
    PhotoSet("GoPro", "pycalib_gopro_charuco", BoardSpec(18, 9, 0.02, 0.015, "DICT_4X4_250"), "rational", 0.301),
    PhotoSet("endoscope, left", "ucl_axis_tests_charuco/ExtractedFrames_L", _ENDOSCOPE, "opencv5", 0.571),
    PhotoSet("endoscope, right", "ucl_axis_tests_charuco/ExtractedFrames_R", _ENDOSCOPE, "opencv5", 0.538),
)


def main() -> None:
    """Measure, and replace the tables of the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("page", type=Path)
    args = parser.parse_args()
    replace_marked(args.page, "benchmarks/real_sets.py", tables(args.data))


def tables(data: Path) -> str:
    """All tables of the page, in Markdown."""
    views = {one.title: detect_folder(data / one.folder, one.spec) for one in SETS}
    solved = {one.title: solve_lens(views[one.title], one.spec) for one in SETS}
    flags = [_flag_rows(one, data, views[one.title]) for one in SETS if one.spec is _ENDOSCOPE]
    parts = [
        "### The lenses",
        markdown(
            ("set", "model", "rms px", "held out px", "fx px", "fy px", "cx px", "cy px", "halves", "as published"),
            [_lens_row(one, solved[one.title]) for one in SETS],
        ),
        "### How well each lens is known",
        "Standard deviation of a projected point in its worst direction, once with the camera's pose fixed, once "
        "without the part that a rotation of the camera explains (*turning*); and of a ray at the board's distance.",
        markdown(
            ("set", "middle px", "worst px", "middle px, turning", "worst px, turning", "board at m", "middle mm"),
            [_uncertainty_row(one, solved[one.title]) for one in SETS],
        ),
        "### The models compared",
        markdown(
            ("set", "model", "rms px", "held out px", "halves differ by", "p", "folds"),
            [row for one in SETS for row in _candidate_rows(one, solved[one.title])],
        ),
        "### What was used and what was not",
        markdown(
            ("set", "photos", "used", "corners", "outliers", "photos dropped, and why", "board"),
            [_used_row(one, solved[one.title], len(views[one.title])) for one in SETS],
        ),
        "### The endoscope's board with the wrong legacy flag",
        markdown(
            ("set", "flag", "rms px", "corners", "fx px", "what `vbaa intrinsics` says"),
            [row for rows in flags for row in rows],
        ),
    ]
    return "\n\n".join(parts)


def _lens_row(one: PhotoSet, solution: LensSolution) -> list[str]:
    """One set's row of the first table."""
    matrix, covariance = solution.camera.matrix, solution.camera.covariance
    assert covariance is not None
    std = np.sqrt(np.diag(covariance)[:4])
    values = [f"{value:.2f} ± {own:.2f}" for value, own in zip(matrix[[0, 1, 0, 1], [0, 1, 2, 2]], std, strict=True)]
    chosen = next(candidate for candidate in solution.comparison if candidate.model == solution.model)
    agree = "agree" if chosen.split_half_agrees else "**differ**"
    rms = f"{solution.rms_inliers_px:.3f}"
    published = f"{one.reference_model}, rms {one.reference_rms_px:.3f}"
    return [one.title, solution.model, rms, f"{chosen.held_out_rms_px:.3f}", *values, agree, published]


def _uncertainty_row(one: PhotoSet, solution: LensSolution) -> list[str]:
    """One set's row of the second table."""
    fixed, turning = (projection_uncertainty(solution.camera, compensated)[2] for compensated in (False, True))
    row, column = (size // 2 for size in fixed.shape)
    middle = np.array(solution.camera.image_size) / 2.0 - 0.5
    distance = float(np.median([view.T_camera_board.translation_m[2] for view in solution.views]))
    by_lens = ray_derivatives(solution.camera.intrinsics, middle)[2]
    ray = float(np.sqrt(np.linalg.eigvalsh(by_lens @ solution.camera.covariance @ by_lens.T)[-1]))
    cells = [fixed[row, column], np.nanmax(fixed), turning[row, column], np.nanmax(turning)]
    return [one.title, *(f"{cell:.3f}" for cell in cells), f"{distance:.2f}", f"{1e3 * distance * ray:.3f}"]


def _candidate_rows(one: PhotoSet, solution: LensSolution) -> list[list[str]]:
    """One set's rows of the comparison; the chosen model is in bold."""
    rows = []
    for candidate in solution.comparison:
        name = f"**{candidate.model}**" if candidate.model == solution.model else candidate.model
        halves = "–" if candidate.halves is None else f"{candidate.halves:.1f} σ"
        p_value = "–" if candidate.halves_p_value is None else f"{candidate.halves_p_value:.1g}"
        numbers = [f"{candidate.rms_px:.4f}", f"{candidate.held_out_rms_px:.4f}", halves, p_value]
        rows.append([one.title, name, *numbers, "no" if candidate.monotonic else "yes"])
    return rows


def _used_row(one: PhotoSet, solution: LensSolution, photos: int) -> list[str]:
    """One set's row of what was used."""
    reasons = Counter(view.reason for view in solution.dropped)
    dropped = "; ".join(f"{count} × {reason}" for reason, count in reasons.most_common()) or "none"
    corners, outliers = (sum(getattr(view, name) for view in solution.views) for name in ("corners", "left_out"))
    bend = ", ".join(solution.board_shape.findings) or "flat and square"
    return [one.title, str(photos), str(len(solution.views)), str(corners), str(outliers), dropped, bend]


def _flag_rows(one: PhotoSet, data: Path, right: Sequence[BoardView]) -> list[list[str]]:
    """Solves for five coefficients: a row with the right legacy flag, one past the check with the wrong."""
    spec = replace(one.spec, legacy_pattern=not one.spec.legacy_pattern)
    paths = list_images(data / one.folder)
    views = [detect_corners(read_gray(path), spec, path.name) for path in paths]
    try:
        detect_folder(data / one.folder, spec)
        refusal = "nothing: it is not caught"
    except InputError as error:
        refusal = str(error).split(": ", 1)[-1]
    rows = []
    for flag, seen, own, words in (("right", right, one.spec, "–"), ("wrong", views, spec, refusal)):
        solution = solve_intrinsics(list(seen), own, "opencv5")
        corners = sum(view.corners for view in solution.views)
        focal = f"{solution.camera.matrix[0, 0]:.1f}"
        rows.append([one.title, flag, f"{solution.rms_inliers_px:.3f}", str(corners), focal, words])
    return rows


if __name__ == "__main__":
    main()
