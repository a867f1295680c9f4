"""Faults put into sets of views: what is found, how small it may be, and that clean sets are left in peace."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.optimize import brentq

import vbaa_calib.calibrate.report  # noqa: F401, its modules must not first be loaded while detect_folder is another
from targets.board import corner_points
from vbaa_calib.calibrate.lens.board_shape import STRETCH
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.cli.main import main
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.diagnose.boards import ViewSet, _find_change, view_set_diagnoses
from vbaa_calib.geometry import Pose

from .photo_sets import detected
from .synthetic_views import SPEC, board_view, pose_towards, projection

SIZE = (1280, 720)
INTRINSICS = np.array([1100.0, 1102.0, 640.0, 362.0, -0.18, 0.06, 7e-4, -5e-4])


def pictures(
    seed: int,
    focal: Sequence[float] | np.ndarray,
    shift_px: np.ndarray | None = None,
    aspect: float = 0.0,
    unflat_m: float = 0.0,
    sigma_px: float = 0.05,
    poses: Sequence[Pose] | None = None,
    intrinsics: np.ndarray = INTRINSICS,
) -> list[BoardView]:
    """One view for each factor of the focal length; the centre moves to the right by a shift for each.

    unflat_m : the print's corners are off by so much in all directions, alike in all views.
    """
    rng = np.random.default_rng(seed)
    placed = [pose_towards(rng, 0.16, 0.8) for _ in focal] if poses is None else poses
    points = corner_points(SPEC) * (1.0, 1.0 + aspect, 1.0)
    points = points + unflat_m * rng.normal(size=points.shape)
    views = []
    for index, (pose, factor) in enumerate(zip(placed, focal, strict=True)):
        lens = intrinsics * np.array([factor, factor, 1, 1, 1, 1, 1, 1])
        lens[2] += 0.0 if shift_px is None else shift_px[index]
        pixels = projection("opencv", points, np.array([*pose.rotvec_rad, *pose.translation_m]), lens)[0]
        views.append(board_view(f"{index:02d}.png", pixels, SIZE, rng, sigma_px))
    return views


def solved(views: Sequence[BoardView]) -> LensSolution:
    return solve_intrinsics(views, SPEC, "opencv4")


def linear(views: Sequence[BoardView]) -> ViewSet:
    found = ViewSet.of(views, solved(views), SPEC)
    assert found is not None
    return found


def names(views: Sequence[BoardView]) -> list[str]:
    return [one.name for one in view_set_diagnoses(views, solved(views), SPEC)]


def test_a_view_of_another_zoom_is_named() -> None:
    for seed, odd in ((0, 3), (1, 9)):
        views = pictures(seed, np.where(np.arange(14) == odd, 1.04, 1.0))
        found = next(one for one in view_set_diagnoses(views, solved(views), SPEC) if one.name == "odd_view")
        assert found.grave
        assert f"{odd:02d}.png" in found.words


@pytest.mark.parametrize("unflat_m", [pytest.param(0.0, marks=pytest.mark.slow), 5e-5])
def test_the_size_of_a_step_is_off_by_what_its_deviation_says(unflat_m: float) -> None:
    """With an uneven print too, whose misfit is ten times the corners' noise."""
    off, at = [], (np.arange(16) >= 8).astype(float)[None]
    for seed in range(16):
        views = linear(pictures(seed, np.repeat([1.0, 1.003], 8), unflat_m=unflat_m))
        _, size, std, _ = _find_change(*views.own_scores(ViewSet.FOCAL), at, views.variance_px2, 0.01)
        off.append((size - 0.003) / std)
    assert np.mean(off) == pytest.approx(0.0, abs=0.6)
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.4


def test_a_change_of_focus_is_found_where_it_happens() -> None:
    for seed, first in ((0, 6), (1, 9), (2, 4)):
        views = pictures(seed, np.where(np.arange(14) < first, 1.0, 1.006))
        found = view_set_diagnoses(views, solved(views), SPEC)
        assert found[0].name == "focus_changed"
        assert found[0].grave
        assert f"between {first - 1:02d}.png and {first:02d}.png by +0.6" in found[0].words or "+0.5" in found[0].words


def test_a_shifted_picture_is_found_with_its_direction() -> None:
    for seed, shift in ((0, 8.0), (1, -8.0)):
        views = pictures(seed, np.ones(14), shift_px=np.where(np.arange(14) < 7, 0.0, shift))
        (found,) = [one for one in view_set_diagnoses(views, solved(views), SPEC) if one.name == "centre_moved"]
        assert ("to the right" if shift > 0 else "to the left") in found.words
        assert 6.0 < float(found.words.split(" by ")[1].split()[0]) < 10.0


def behind_glass(points: np.ndarray, pose: Pose, thickness_m: float) -> np.ndarray:
    """(N, 3) where a board's points seem to be behind a plate of index 1.5 on it."""
    camera, moved = pose.inverse().translation_m, points.copy()
    height = abs(camera[2]) - thickness_m
    for place, way in enumerate((points - camera)[:, :2]):
        far = np.linalg.norm(way)

        def bent(sine: float) -> float:
            return thickness_m * sine / np.sqrt(2.25 - sine**2)

        def missed(sine: float, far: float = far) -> float:
            return height * sine / np.sqrt(1.0 - sine**2) + bent(sine) - far

        sine = brentq(missed, 0.0, 0.999)
        moved[place, :2] += way / far * (thickness_m * sine / np.sqrt(1.0 - sine**2) - bent(sine))
    return moved


def test_glass_before_the_board_is_found_with_its_thickness() -> None:
    for seed, thickness_m in ((0, 2e-3), (1, 4e-3)):
        rng = np.random.default_rng(seed)
        views = []
        for index in range(14):
            pose = pose_towards(rng, 0.16, 0.8)
            points = behind_glass(corner_points(SPEC), pose, thickness_m)
            views.append(
                board_view(
                    f"{index:02d}.png", projection("opencv", points, pose.vector, INTRINSICS)[0], SIZE, rng, 0.05
                )
            )
        found = next(one for one in view_set_diagnoses(views, solved(views), SPEC) if one.name == "board_behind_glass")
        assert found.grave
        size, std = (float(found.words.split("behind ")[1].split(" mm")[0].split(" ± ")[side]) for side in (0, 1))
        assert abs(size - 1e3 * thickness_m) < 3.0 * std + 0.1


@pytest.mark.parametrize("unflat_m", [0.0, 5e-5])
def test_clean_sets_raise_no_alarm(unflat_m: float) -> None:
    for seed in range(8):
        found = names(pictures(100 + seed, np.ones(12), unflat_m=unflat_m))
        assert not {"focus_changed", "focus_crept", "centre_moved"} & set(found)
        assert unflat_m or "print_stretched" not in found


def test_a_stretched_print_is_measured_and_the_lens_solved_with_it() -> None:
    off, focal = [], []
    for seed in range(8):
        solution = solved(pictures(seed, np.ones(12), aspect=0.017))
        shape, std = solution.board_shape, np.sqrt(np.diag(solution.camera.covariance))
        off.append((shape.parameters[STRETCH] + 0.017 / 1.0085) / shape.std[STRETCH])
        # the print is larger by half of that than its squares say
        focal.append((solution.camera.parameters[:2] - INTRINSICS[:2]) / std[:2])
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.6
    assert 0.5 < np.sqrt(np.mean(np.square(focal))) < 1.6
    views = pictures(0, np.ones(12), aspect=-0.007)
    found = next(one for one in view_set_diagnoses(views, solved(views), SPEC) if one.name == "print_stretched")
    assert "longer along its x than along its y by 0.7" in found.words


@pytest.mark.parametrize("name", ["gopro", pytest.param("realsense", marks=pytest.mark.slow)])
def test_real_sets_raise_no_alarm_about_the_lens(name: str) -> None:
    """Their corners miss the fit by several times their noise, whole views together."""
    views, spec = detected(name)
    found = view_set_diagnoses(views, solve_intrinsics(views, spec, "fisheye" if name == "gopro" else "radial"), spec)
    assert not {"focus_changed", "focus_crept", "centre_moved"} & {one.name for one in found}


@pytest.mark.parametrize(("later_focal", "grade"), [(1.0, "trusted"), (1.008, "do not use")])
def test_file_terminal_and_exit_code_agree(
    later_focal: float, grade: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A lens that was touched midway must not be used, whatever its residuals."""
    views = pictures(3, np.repeat([1.0, later_focal], 10))
    monkeypatch.setattr("vbaa_calib.detect.board.corners.detect_folder", lambda *_: views)
    board, out, photos = tmp_path / "board.yaml", tmp_path / "camera.json", tmp_path / "photos"
    board.write_text(yaml.safe_dump({"board": SPEC.to_dict()}))
    photos.mkdir()
    (photos / "00.png").touch()
    call = ["intrinsics", str(photos), "--board", str(board), "-o", str(out), "--lens-model", "opencv5", "--json"]
    code = main(call)
    said, file = capsys.readouterr(), json.loads(out.read_text())
    result = json.loads(said.out)
    assert tuple(file["image_size"]) == SIZE
    assert (file["grade"], file["trusted"], code) == (grade, grade == "trusted", int(grade == "do not use"))
    assert f"verdict    {file['verdict']}\n" in said.err
    assert len(file["warnings"]) == len(file["diagnoses"]) == said.err.count("look at ") + said.err.count("wrong ")
    assert any(one["grave"] for one in file["diagnoses"]) == (grade == "do not use")
    assert {key: result[key] for key in file} == file
