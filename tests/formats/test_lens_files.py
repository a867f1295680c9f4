"""Lens files as people have them: each is read as it is meant, refitted with its error stated, or asked about."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from vbaa_calib.calibrate.given_lens import read_lens
from vbaa_calib.cli.main import main
from vbaa_calib.convert import guessed
from vbaa_calib.convert.values import Exchanged, Wanted
from vbaa_calib.core.errors import InputError
from vbaa_calib.streams.bags import BagWriter, Logged

SIZE = (1280, 960)
K = np.array([[900.0, 0.0, 639.5], [0.0, 905.0, 479.5], [0.0, 0.0, 1.0]])
D = np.array([-0.2, 0.1, 1e-3, -5e-4, 0.01])
P = [850.0, 0.0, 640.0, 0.0, 0.0, 860.0, 480.0, 0.0, 0.0, 0.0, 1.0, 0.0]


AS_IT_SAYS = Wanted()


def read(path: Path, wanted: Wanted = AS_IT_SAYS) -> Exchanged:
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
    camera = read(tmp_path / name, wanted).camera
    assert (camera.model, camera.image_size) == ("opencv", SIZE)
    np.testing.assert_allclose(camera.matrix, K, rtol=1e-12)
    np.testing.assert_allclose(camera.distortion, D, rtol=1e-12)


def test_colmaps_binary_file(tmp_path: Path) -> None:
    values = [900.0, 905.0, 640.0, 480.0, *D[:4]]
    (tmp_path / "cameras.bin").write_bytes(struct.pack("<QiiQQ8d", 1, 1, 4, *SIZE, *values))
    camera = read(tmp_path / "cameras.bin").camera
    np.testing.assert_allclose(camera.matrix, K)
    np.testing.assert_allclose(camera.distortion, D[:4])
    (tmp_path / "cameras.bin").write_bytes(b"\1")
    with pytest.raises(InputError, match=r"cameras\.bin"):
        read(tmp_path / "cameras.bin")


ASKED: list[tuple[str, str, Any, str]] = [
    ("no size", "a.json", {"mtx": K.tolist(), "dist": [D.tolist()]}, "--size"),
    (
        "a size that may be turned",
        "a.json",
        {"K": K.tolist(), "D": D.tolist(), "image_size": SIZE[::-1]},
        "--size 1280x960",
    ),
    ("four coefficients", "a.json", {"K": K.tolist(), "D": D[:4].tolist(), "width": 1280, "height": 960}, "--fisheye"),
    ("two cameras", "a.yaml", ORB + ORB.replace("Camera1", "Camera2"), "--camera-name"),
    ("not calibrated", "a.yaml", echo(k=np.zeros((3, 3))), "not calibrated"),
]


@pytest.mark.parametrize(("name", "content", "words"), [pytest.param(*row[1:], id=row[0]) for row in ASKED])
def test_two_readings_are_asked_about(tmp_path: Path, name: str, content: Any, words: str) -> None:
    text(content)(tmp_path / name)
    with pytest.raises(InputError, match=words):
        read(tmp_path / name)


def test_the_lens_of_binned_and_cropped_pictures(tmp_path: Path) -> None:
    """A point's pixel in the part is its pixel in the whole, moved and binned; as CameraInfo says, or as asked for."""
    path, more = (
        tmp_path / "a.yaml",
        "binning_x: 2\nbinning_y: 2\nroi:\n  x_offset: 40\n  y_offset: 20\n  height: 600\n",
    )
    text(echo(more=more + "  width: 800\n  do_rectify: false\n"))(path)
    own = read(path)
    asked = read(path, Wanted(binning=(4, 2), roi=(40, 20, 800, 600))).camera
    whole = read(path, Wanted(binning=(1, 1), roi=(0, 0, *SIZE))).camera
    points = np.array([[0.01, 0.02, 1.0], [-0.2, 0.1, 0.9]])
    expected = (whole.project(points)[0] - [40.0, 20.0] + 0.5) / 2.0 - 0.5
    np.testing.assert_allclose(own.camera.project(points)[0], expected, atol=1e-9)
    np.testing.assert_allclose(asked.project(points)[0], (2.0 * expected + 0.5) / [4, 2] - [0.375, 0.25], atol=1.0)
    assert (own.camera.image_size, asked.image_size) == ((400, 300), (200, 300))
    assert any("binning 2x2" in note for note in own.notes)
    with pytest.raises(InputError, match="not inside"):
        read(path, Wanted(roi=(1000, 0, 800, 600)))


def test_rectified_pictures_have_the_projections_lens(tmp_path: Path) -> None:
    path = tmp_path / "ost.ini"
    text(OST)(path)
    camera = read(path, Wanted(rectified=True)).camera
    assert (camera.matrix[0, 0], camera.matrix[1, 1], camera.distortion.size) == (850.0, 860.0, 0)
    for rectified in (False, True):
        (note,) = read(path, Wanted(rectified=rectified)).notes
        for part in ("image_raw", "fx 900 px", "image_rect", "fx 850 px"):
            assert part in note
    bag(tmp_path / "a.mcap", "/left/image_rect")
    assert "/left/image_rect" in read(tmp_path / "a.mcap", Wanted("/left/camera_info")).notes[-1]
    bag(tmp_path / "b.mcap", "/right/image_rect")
    assert not read(tmp_path / "b.mcap", Wanted("/left/camera_info")).notes
    text(ORB)(tmp_path / "a.yaml")
    with pytest.raises(InputError, match="rectified"):
        read(tmp_path / "a.yaml", Wanted(size=SIZE, rectified=True))


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


def test_mrcals_splines_carry_what_they_can_carry(tmp_path: Path) -> None:
    """Control points that lie on a plane shift stereographic points by just that; the region bounds the fit."""
    x, y = np.meshgrid((np.arange(12) - 5.5), (np.arange(9) - 4.0))
    per_unit = (12 - 1 - 2) / (4.0 * np.tan(np.radians(100.0) / 4.0))
    shifts = np.stack([0.05 * x / per_unit, -0.02 * y / per_unit], axis=-1).ravel().tolist()
    text_of = "{{'lens_model': 'LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=12_Ny=9_fov_x_deg=100', 'intrinsics': {},"
    text_of += " 'extrinsics': [0,0,0,0,0,0], 'imagersize': [1280, 960],"
    text_of += " 'valid_intrinsics_region': [[100,100],[1180,100],[1180,860],[100,860],[100,100]]}}"
    path = tmp_path / "a.cameramodel"
    path.write_text(text_of.format([700.0, 700.0, 639.5, 479.5, *shifts]))
    found = read(path)
    angle, around = np.meshgrid(np.linspace(0.02, 0.5, 9), np.linspace(0.0, 6.0, 11))
    rays = np.stack([np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)], -1).reshape(-1, 3)
    plane = 2.0 * rays[:, :2] / (1.0 + rays[:, 2:])
    np.testing.assert_allclose(found.camera.project(rays)[0], 700.0 * plane * [1.05, 0.98] + [639.5, 479.5], atol=0.05)
    assert "in its valid_intrinsics_region" in found.notes[-1]


@pytest.mark.parametrize(
    ("model", "down", "most_px"), [("CAHVOR", "0 900 479.5", 0.02), ("CAHVORE1, general", "0.9 900 479.5", 1.0)]
)
def test_cahvor_about_its_axis_is_a_radial_lens(tmp_path: Path, model: str, down: str, most_px: float) -> None:
    path = tmp_path / "a.cahvor"
    vectors = f"C = 0.1 0.2 0.3\nA = 0 0 1\nH = 900 0 639.5\nV = {down}\nO = 0 0 1\nR = 0.0 -0.2 0.05\n"
    path.write_text(f"Model = {model} = perspective\nDimensions = 1280 960\n{vectors}")
    found = read(path)
    assert found.T_reference_camera is not None
    np.testing.assert_allclose(found.T_reference_camera.translation_m, [0.1, 0.2, 0.3])
    points = np.column_stack([np.random.default_rng(1).uniform(-0.5, 0.5, (50, 2)), np.ones(50)])
    square = (points[:, :2] ** 2).sum(axis=1, keepdims=True)
    expected = points[:, :2] * (1.0 - 0.2 * square + 0.05 * square**2)
    expected = expected @ np.array([[900.0, float(down.split()[0])], [0.0, 900.0]]) + [639.5, 479.5]
    np.testing.assert_allclose(found.camera.project(points)[0], expected, atol=most_px)


def test_a_skew_is_refitted_and_its_error_stated(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    text(echo(k=K + np.array([[0.0, 0.5, 0.0], [0.0] * 3, [0.0] * 3])))(path)
    found = read(path)
    points = np.column_stack([np.random.default_rng(2).uniform(-0.4, 0.4, (60, 2)), np.ones(60)])
    skewed = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, D)[0][:, 0]
    skewed[:, 0] += 0.5 * (skewed[:, 1] - K[1, 2]) / K[1, 1]
    assert np.linalg.norm(found.camera.project(points)[0] - skewed, axis=1).max() < 0.3
    assert "px rms" in found.notes[0]
    assert found.camera.valid_region().image_fraction == 1.0


def test_a_refits_error_goes_with_the_lens(tmp_path: Path) -> None:
    """Of any file with a skew; from the file that convert writes, too, and into what a calibration says."""
    skewed = K + np.array([[0.0, 1.5, 0.0], [0.0] * 3, [0.0] * 3])
    text({"mtx": skewed.tolist(), "dist": D.tolist(), "image_size": SIZE})(tmp_path / "a.json")
    assert main(["convert", str(tmp_path / "a.json"), "-o", str(tmp_path / "camera.json")]) == 0
    for name in ("a.json", "camera.json"):
        (note,) = read_lens(tmp_path / name).doubts
        assert "skew of 1.5 px" in note.words
        assert "px rms" in note.words
