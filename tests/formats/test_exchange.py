"""Other programs' files, in and out: what is written is what is read, as those programs take it."""

from __future__ import annotations

import ast
import json
import struct
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from vbaa_calib.calibrate.given_lens import read_lens
from vbaa_calib.camera import Camera
from vbaa_calib.convert import FORMATS, guessed
from vbaa_calib.convert.values import Exchanged, Wanted
from vbaa_calib.core.errors import InputError
from vbaa_calib.streams.bags import BagWriter, Logged

from .files import POSE, READ_ONLY, SAMPLES, WHICH, camera, fisheye, points

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


@pytest.mark.parametrize("name", sorted(SAMPLES | READ_ONLY))
def test_a_file_tells_its_format_by_itself(name: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text((SAMPLES | READ_ONLY)[name])
    assert guessed(tmp_path / "file").name == name
    for lens in (camera(4), fisheye()):
        if name in HELD and holds(name, lens):
            (tmp_path / "ours").write_text(FORMATS[name].write(Exchanged(lens, POSE)))
            assert guessed(tmp_path / "ours").name == name


SIZE = (1280, 960)
K = np.array([[900.0, 0.0, 639.5], [0.0, 905.0, 479.5], [0.0, 0.0, 1.0]])
D = np.array([-0.2, 0.1, 1e-3, -5e-4, 0.01])
P = [850.0, 0.0, 640.0, 0.0, 0.0, 860.0, 480.0, 0.0, 0.0, 0.0, 1.0, 0.0]


AS_IT_SAYS = Wanted()


def read_files(path: Path, wanted: Wanted = AS_IT_SAYS) -> Exchanged:
    return guessed(path).read(path, wanted)


def rows(values: Any) -> str:
    return "\n".join(" ".join(f"{cell:.6f}" for cell in row) for row in np.atleast_2d(values))


def echo(d: Any = D, model: str = "plumb_bob", more: str = "", k: np.ndarray = K) -> str:
    """As ROS 2 prints it."""
    lists = "".join(
        f"{key}:\n" + "".join(f"- {cell!r}\n" for cell in each)
        for key, each in (
            ("d", np.asarray(d).tolist()),
            ("k", k.ravel().tolist()),
            ("r", np.eye(3).ravel().tolist()),
            ("p", P),
        )
    )
    head = "header:\n  stamp:\n    sec: 17\n    nanosec: 4\n  frame_id: camera\n"
    return f"{head}height: 960\nwidth: 1280\ndistortion_model: {model}\n{lists}{more}---\n"


ROS1 = f"""header:
  seq: 85
  frame_id: "camera_link"
height: 960
width: 1280
distortion_model: "plumb_bob"
D: {D.tolist()}
K: {K.ravel().tolist()}
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
P: {P}
binning_x: 0
binning_y: 0
roi:
  x_offset: 0
  y_offset: 0
  height: 0
  width: 0
  do_rectify: False
---
header:
  seq: 86
---
"""
OST = "# oST version 5.0 parameters\n\n\n[image]\n\nwidth\n1280\n\nheight\n960\n\n[narrow_stereo]\n\n"
OST += f"camera matrix\n{rows(K)}\n\n"
OST += f"distortion\n{rows(D)}\n\nrectification\n{rows(np.eye(3))}\n\nprojection\n{rows(np.reshape(P, (3, 4)))}\n\n"
LISTS = {"rows": 3, "cols": 3, "type": 6, "data": K.ravel().tolist()}
PHOTONVISION = {
    "resolution": {"width": 1280.0, "height": 960.0},
    "cameraIntrinsics": LISTS,
    "distCoeffs": {"rows": 1, "cols": 5, "type": 6, "data": D.tolist()},
    "observations": [],
    "lensmodel": "LENSMODEL_OPENCV",
}
ORB = '%YAML:1.0\n\nFile.version: "1.0"\nCamera.type: "PinHole"\n' + "".join(
    f"Camera1.{key}: {value}\n"
    for key, value in zip(
        ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"), [900.0, 905.0, 639.5, 479.5, *D], strict=True
    )
)


def stereo(path: Path) -> None:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for key, value in (("M1", 2.0 * K), ("D1", D[None]), ("M2", K), ("D2", D[None])):
        storage.write(key, value)
    storage.release()


def npz(path: Path) -> None:
    np.savez(path, mtx=K, dist=D[None], rvecs=np.zeros((4, 3, 1)), names=np.array([{}, {}], object))


def bag(path: Path, *pictures: str) -> None:
    writer = BagWriter(path)
    for topic in pictures:
        writer.write(Logged(topic, "sensor_msgs/msg/Image", {"encoding": "mono8"}, 10**9))
    about = {"width": 1280, "height": 960, "distortion_model": "plumb_bob", "d": D, "k": K.ravel()}
    for topic, factor in (("/left/camera_info", 1.0), ("/right/camera_info", 2.0)):
        writer.write(Logged(topic, "sensor_msgs/msg/CameraInfo", about | {"k": factor * K.ravel()}, 10**9))
    writer.close()


def text(content: Any) -> Callable[[Path], None]:
    return lambda path: path.write_text(content if isinstance(content, str) else json.dumps(content)) and None


SIZED = Wanted(size=SIZE)
FILES: list[tuple[str, str, Callable[[Path], None], Wanted]] = [
    ("echo of ROS 2", "a.yaml", text(echo()), AS_IT_SAYS),
    ("echo of ROS 1, twice", "a.yaml", text(ROS1), AS_IT_SAYS),
    ("five of a rational", "a.yaml", text(echo(model="rational_polynomial")), AS_IT_SAYS),
    ("ost.ini", "ost.ini", text(OST), AS_IT_SAYS),
    ("a bag's topic", "a.mcap", bag, Wanted("/left/camera_info")),
    ("mtx and dist", "a.json", text({"mtx": K.tolist(), "dist": [D.tolist()]}), SIZED),
    (
        "named, with its size",
        "a.json",
        text({"camera_matrix": K.tolist(), "dist_coeff": D.tolist(), "image_size": SIZE}),
        AS_IT_SAYS,
    ),
    ("YAML of lists", "a.yaml", text(f"camera_matrix: {K.tolist()}\ndist_coeff: {[D.tolist()]}\n"), SIZED),
    ("the tutorial's .npz", "B.npz", npz, SIZED),
    ("PhotonVision", "a.json", text(PHOTONVISION), AS_IT_SAYS),
    ("OpenCV's stereo", "intrinsics.yml", stereo, Wanted("2", SIZE)),
    ("ORB-SLAM3", "a.yaml", text(ORB + "Camera.width: 1280\nCamera.height: 960\n"), AS_IT_SAYS),
    ("ORB-SLAM2", "a.yaml", text(ORB.replace("Camera1", "Camera")), SIZED),
]


@pytest.mark.parametrize(("name", "make", "wanted"), [pytest.param(*row[1:], id=row[0]) for row in FILES])
def test_it_is_read_as_it_is_meant(tmp_path: Path, name: str, make: Callable[[Path], None], wanted: Wanted) -> None:
    make(tmp_path / name)
    camera = read_files(tmp_path / name, wanted).camera
    assert (camera.model, camera.image_size) == ("opencv", SIZE)
    np.testing.assert_allclose(camera.matrix, K, rtol=1e-12)
    np.testing.assert_allclose(camera.distortion, D, rtol=1e-12)


def test_colmaps_binary_file(tmp_path: Path) -> None:
    values = [900.0, 905.0, 640.0, 480.0, *D[:4]]
    (tmp_path / "cameras.bin").write_bytes(struct.pack("<QiiQQ8d", 1, 1, 4, *SIZE, *values))
    camera = read_files(tmp_path / "cameras.bin").camera
    np.testing.assert_allclose(camera.matrix, K)
    np.testing.assert_allclose(camera.distortion, D[:4])
    (tmp_path / "cameras.bin").write_bytes(b"\1")
    with pytest.raises(InputError, match=r"cameras\.bin"):
        read_files(tmp_path / "cameras.bin")


def test_the_lens_of_binned_and_cropped_pictures(tmp_path: Path) -> None:
    """A point's pixel in the part is its pixel in the whole, moved and binned; as CameraInfo says, or as asked for."""
    path, more = (
        tmp_path / "a.yaml",
        "binning_x: 2\nbinning_y: 2\nroi:\n  x_offset: 40\n  y_offset: 20\n  height: 600\n",
    )
    text(echo(more=more + "  width: 800\n  do_rectify: false\n"))(path)
    own = read_files(path)
    asked = read_files(path, Wanted(binning=(4, 2), roi=(40, 20, 800, 600))).camera
    whole = read_files(path, Wanted(binning=(1, 1), roi=(0, 0, *SIZE))).camera
    points = np.array([[0.01, 0.02, 1.0], [-0.2, 0.1, 0.9]])
    expected = (whole.project(points)[0] - [40.0, 20.0] + 0.5) / 2.0 - 0.5
    np.testing.assert_allclose(own.camera.project(points)[0], expected, atol=1e-9)
    np.testing.assert_allclose(asked.project(points)[0], (2.0 * expected + 0.5) / [4, 2] - [0.375, 0.25], atol=1.0)
    assert (own.camera.image_size, asked.image_size) == ((400, 300), (200, 300))
    assert any("binning 2x2" in note for note in own.notes)
    with pytest.raises(InputError, match="not inside"):
        read_files(path, Wanted(roi=(1000, 0, 800, 600)))


def rays_of(model: str, values: list[float], pixels: np.ndarray) -> np.ndarray:
    """Directions of pixels by the closed inverses of the models' papers, which the reader does not use."""
    *own, fx, fy, cx, cy = values
    m = (pixels - [cx, cy]) / [fx, fy]
    square = (m**2).sum(axis=1)
    match model:
        case "omni":
            factor = (own[0] + np.sqrt(1.0 + (1.0 - own[0] ** 2) * square)) / (1.0 + square)
            return np.column_stack([m * factor[:, None], factor - own[0]])
        case "ds":
            xi, alpha = own
            z = (1.0 - alpha**2 * square) / (alpha * np.sqrt(1.0 - (2.0 * alpha - 1.0) * square) + 1.0 - alpha)
            factor = (z * xi + np.sqrt(z**2 + (1.0 - xi**2) * square)) / (z**2 + square)
            return np.column_stack([m * factor[:, None], factor * z - xi])
        case "eucm":
            alpha, beta = own
            z = (1.0 - beta * alpha**2 * square) / (
                alpha * np.sqrt(1.0 - (2.0 * alpha - 1.0) * beta * square) + 1.0 - alpha
            )
            return np.column_stack([m, z])
    radius = np.sqrt(square)
    ideal = np.tan(radius * 0.9) / (2.0 * np.tan(0.45))
    return np.column_stack([m * (ideal / radius)[:, None], np.ones(len(m))])


OTHERS = [
    ("omni", "omni", [1.2, 1500.0, 1500.0, 635.0, 470.0], "none", [], 0.05),
    ("ds", "ds", [-0.2, 0.59, 360.0, 361.0, 635.0, 470.0], "none", [], 0.05),
    ("eucm", "eucm", [0.6, 1.1, 460.0, 460.0, 639.5, 479.5], "none", [], 0.05),
    ("fov", "pinhole", [600.0, 600.0, 639.5, 479.5], "fov", [0.9], 0.01),
]


@pytest.mark.parametrize(("model", "camera_model", "values", "distortion", "coefficients", "most_px"), OTHERS)
def test_another_model_is_refitted_and_its_error_stated(
    tmp_path: Path,
    model: str,
    camera_model: str,
    values: list[float],
    distortion: str,
    coefficients: list[float],
    most_px: float,
) -> None:
    path = tmp_path / "camchain.yaml"
    path.write_text(
        f"cam0:\n  camera_model: {camera_model}\n  intrinsics: {values}\n  distortion_model: {distortion}\n"
        f"  distortion_coeffs: {coefficients}\n  resolution: [1280, 960]\n"
    )
    pixels = np.random.default_rng(0).uniform([20, 20], [1260, 940], (300, 2))
    lens = read_lens(path)
    seen, valid = lens.camera.project(rays_of(model, values, pixels))
    assert valid.all()
    assert np.linalg.norm(seen - pixels, axis=1).max() < most_px
    (note,) = lens.doubts
    assert ("px rms" in note.words, note.severity) == (True, "note")


@pytest.mark.parametrize(
    ("model", "down", "most_px"), [("CAHVOR", "0 900 479.5", 0.02), ("CAHVORE1, general", "0.9 900 479.5", 1.0)]
)
def test_cahvor_about_its_axis_is_a_radial_lens(tmp_path: Path, model: str, down: str, most_px: float) -> None:
    path = tmp_path / "a.cahvor"
    vectors = f"C = 0.1 0.2 0.3\nA = 0 0 1\nH = 900 0 639.5\nV = {down}\nO = 0 0 1\nR = 0.0 -0.2 0.05\n"
    path.write_text(f"Model = {model} = perspective\nDimensions = 1280 960\n{vectors}")
    found = read_files(path)
    assert found.T_reference_camera is not None
    np.testing.assert_allclose(found.T_reference_camera.translation_m, [0.1, 0.2, 0.3])
    points = np.column_stack([np.random.default_rng(1).uniform(-0.5, 0.5, (50, 2)), np.ones(50)])
    square = (points[:, :2] ** 2).sum(axis=1, keepdims=True)
    expected = points[:, :2] * (1.0 - 0.2 * square + 0.05 * square**2)
    expected = expected @ np.array([[900.0, float(down.split()[0])], [0.0, 900.0]]) + [639.5, 479.5]
    np.testing.assert_allclose(found.camera.project(points)[0], expected, atol=most_px)
