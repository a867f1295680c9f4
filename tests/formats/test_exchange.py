"""Other programs' files: what is written is what is read, and means what the other program takes it to mean."""

from __future__ import annotations

import ast
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from vbaa_calib.camera import Camera
from vbaa_calib.convert import FORMATS, guessed
from vbaa_calib.convert.values import Exchanged, Wanted
from vbaa_calib.core.errors import InputError

from .files import COLMAP, MRCAL, POSE, READ_ONLY, SAMPLES, WHICH, camera, fisheye, points

HELD = {"ros": (0, 4, 5, 8), "opencv": (0, 4, 5, 8, 12, 14), "kalibr": (0, 4), "mrcal": (0, 4, 5, 8, 12)}
HELD |= {"colmap": (0, 4, 5, 8), "vbaa": (0, 4, 5, 8, 12, 14)}
WITH_FISHEYE = {"ros", "opencv", "kalibr", "colmap", "vbaa"}


def read(name: str, text: str, which: str | None = None) -> Exchanged:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "file"
        path.write_text(text)
        return FORMATS[name].read(path, Wanted(which))


def lenses() -> st.SearchStrategy[Camera]:
    """Cameras of both models and all lengths, zeros among the coefficients."""

    def made(model: str, count: int) -> st.SearchStrategy[Camera]:
        small = st.one_of(st.just(0.0), st.floats(-0.5, 0.5, allow_subnormal=False))
        return st.builds(
            lambda size, f, c, k: Camera(model, size, np.array([[f[0], 0, c[0]], [0, f[1], c[1]], [0, 0, 1]]), k),
            st.tuples(st.integers(1, 10000), st.integers(1, 10000)),
            st.tuples(*[st.floats(1.0, 1e5)] * 2),
            st.tuples(*[st.floats(-1e4, 1e4, allow_subnormal=False)] * 2),
            st.lists(small, min_size=count, max_size=count).map(np.array),
        )

    kinds = [made("opencv", count) for count in (0, 4, 5, 8, 12, 14)] + [made("fisheye", 4)]
    return st.one_of(*kinds)


def holds(name: str, lens: Camera) -> bool:
    """Whether a format has a place for all coefficients that are not zero."""
    if lens.model == "fisheye":
        return name in WITH_FISHEYE
    return bool(max(np.flatnonzero(lens.distortion), default=-1) < max(HELD[name]))


@settings(max_examples=30, deadline=None)
@given(lens=lenses(), name=st.sampled_from(sorted(HELD)))
def test_what_is_written_is_read_to_the_last_bit_or_refused(lens: Camera, name: str) -> None:
    if not holds(name, lens):
        with pytest.raises(InputError):
            FORMATS[name].write(Exchanged(lens))
        return
    again = read(name, FORMATS[name].write(Exchanged(lens))).camera
    assert (again.model, again.image_size) == (lens.model, lens.image_size)
    np.testing.assert_array_equal(again.matrix, lens.matrix)
    longest = np.zeros((2, 14))
    longest[0, : lens.distortion.size], longest[1, : again.distortion.size] = lens.distortion, again.distortion
    np.testing.assert_array_equal(longest[0], longest[1])


def parameters(name: str, text: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Matrix, coefficients and the place of the first pixel's centre, each taken from the file in a way of its own."""
    core: list[float]
    match name:
        case "opencv":
            storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
            return storage.getNode("camera_matrix").mat(), storage.getNode("distortion_coefficients").mat().ravel(), 0.0
        case "ros":
            data = yaml.safe_load(text)
            return (
                np.reshape(data["camera_matrix"]["data"], (3, 3)),
                np.array(data["distortion_coefficients"]["data"]),
                0.0,
            )
        case "kalibr":
            data = yaml.safe_load(text)["cam0"]
            core, rest, centre = data["intrinsics"], data["distortion_coeffs"], 0.0
        case "mrcal":
            values = ast.literal_eval(text)["intrinsics"]
            core, rest, centre = values[:4], values[4:], 0.0
        case _:
            cells = text.splitlines()[-1].split()
            values = [float(cell) for cell in cells[4:]]
            core, rest, centre = values[:4], values[4:], 0.5
    fx, fy, cx, cy = core
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), np.array(rest, float), centre


@pytest.mark.parametrize("name", ["ros", "opencv", "kalibr", "mrcal", "colmap"])
def test_opencv_projects_with_the_written_numbers_as_we_do(name: str) -> None:
    for count in HELD[name]:
        lens = camera(count)
        matrix, coefficients, centre = parameters(name, FORMATS[name].write(Exchanged(lens)))
        seen = cv2.projectPoints(points(), np.zeros(3), np.zeros(3), matrix, coefficients)[0].reshape(-1, 2)
        np.testing.assert_allclose(seen - centre, lens.project(points())[0], atol=1e-9)
    if name in WITH_FISHEYE:
        matrix, coefficients, centre = parameters(name, FORMATS[name].write(Exchanged(fisheye())))
        where = points().reshape(-1, 1, 3)
        seen = cv2.fisheye.projectPoints(where, np.zeros(3), np.zeros(3), matrix, coefficients)[0].reshape(-1, 2)
        np.testing.assert_allclose(seen - centre, fisheye().project(points())[0], atol=1e-9)


def test_poses_turn_the_way_that_each_program_means() -> None:
    given_ = Exchanged(camera(4), POSE)
    expected = POSE.inverse() @ points()
    rows = np.array(yaml.safe_load(FORMATS["kalibr"].write(given_))["cam0"]["T_cam_imu"])
    np.testing.assert_allclose(points() @ rows[:3, :3].T + rows[:3, 3], expected, atol=1e-12)
    turn_shift = np.array(ast.literal_eval(FORMATS["mrcal"].write(given_))["extrinsics"])
    turn = cv2.Rodrigues(turn_shift[:3])[0]
    np.testing.assert_allclose(points() @ turn.T + turn_shift[3:], expected, atol=1e-12)
    for name in ("kalibr", "mrcal", "vbaa"):
        again = read(name, FORMATS[name].write(given_)).T_reference_camera
        np.testing.assert_allclose(again.matrix, POSE.matrix, atol=1e-14)
    for name in ("ros", "opencv", "colmap"):
        assert read(name, FORMATS[name].write(given_)).T_reference_camera is None
        assert "the camera's pose" in FORMATS[name].lost(given_)


def test_files_as_the_other_programs_write_them() -> None:
    expected = {
        "ros": (
            [536.5713701935, 537.7138835637, 315.0555172451, 241.0382730485],
            [0.3962120869278, -1.084940116527, -0.000164063842787, -0.005099474937516, 1.008031733388],
        ),
        "opencv": (
            [535.91573396163199, 535.91573396163199, 342.28315473308373, 235.57082909788173],
            [
                -0.2663726090966068,
                -0.03858889892230465,
                0.0017831947042852964,
                -0.0002812210044111547,
                0.23839153080878486,
            ],
        ),
        "kalibr": ([461.629, 460.152, 362.680, 246.049], [-0.27695497, 0.06712482, 0.00087538, 0.00011556]),
        "colmap": ([2559.69, 2559.69, 1535.5, 1151.5], [-0.0218531, 0, 0, 0]),
    }
    for name, (core, coefficients) in expected.items():
        found = read(name, SAMPLES[name], WHICH.get(name))
        matrix = found.camera.matrix
        assert [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]] == core
        assert found.camera.distortion.tolist() == coefficients
        assert not found.notes


def test_mrcals_file_with_its_pose() -> None:
    found = read("mrcal", MRCAL)
    assert found.camera.image_size == (4000, 2200)
    assert found.camera.distortion.size == 8
    turn = cv2.Rodrigues(np.array([2e-2, -3e-1, -1e-2]))[0]
    # the camera's own place is where points of the reference frame come to lie at zero
    np.testing.assert_allclose(found.T_reference_camera.translation_m, -turn.T @ [1.0, 2.0, -3.0], atol=1e-12)
    old = MRCAL.replace("'lens_model'", "'lensmodel'").replace("rt_fromref", "rt_cam_ref")
    assert read("mrcal", old).camera.distortion.size == 8


@pytest.mark.parametrize("name", sorted(SAMPLES | READ_ONLY))
def test_a_file_tells_its_format_by_itself(name: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text((SAMPLES | READ_ONLY)[name])
    assert guessed(tmp_path / "file").name == name
    for lens in (camera(4), fisheye()):
        if name in HELD and holds(name, lens):
            (tmp_path / "ours").write_text(FORMATS[name].write(Exchanged(lens, POSE)))
            assert guessed(tmp_path / "ours").name == name


def test_colmap_counts_pixels_from_their_corner() -> None:
    line = FORMATS["colmap"].write(Exchanged(camera(0))).splitlines()[-1]
    assert line == "1 PINHOLE 960 720 968.1 970.3 483.6 355.9"
    pinhole = read("colmap", COLMAP, "2").camera
    # a centred principal point is w/2 there, (w − 1)/2 here
    assert pinhole.matrix[:2, 2].tolist() == [1535.5, 1151.5]
