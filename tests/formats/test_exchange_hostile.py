"""Files that are wrong end in one line that names the file."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vbaa_calib.convert.table import FORMATS, guessed
from vbaa_calib.core.errors import InputError

from .files import SAMPLES, WHICH

WRONG = [
    ("ros", "image_width: 640", "image_width: 640.5", "image_width is 640.5"),
    ("ros", "image_width: 640", "image_width: -3", "image_width is -3"),
    ("ros", "image_width: 640", "image_width: yes", "image_width is True"),
    ("ros", "image_width: 640\n", "", "image_width is None"),
    ("ros", "plumb_bob", "thin_prism_fisheye", "distortion_model is 'thin_prism_fisheye'"),
    ("ros", "plumb_bob", "[1, 2]", "distortion_model is"),
    ("ros", "plumb_bob", "rational_polynomial", "a list of 8 or 12 or 14 numbers"),
    ("ros", "536.5713701935, 0. , 315", ".nan, 0. , 315", "camera_matrix.data holds nan"),
    ("ros", "536.5713701935, 0. , 315", "0, 0. , 315", "singular or mirrored"),
    ("ros", "536.5713701935, 0. , 315", "536.5, 0.7, 315", "skew"),
    ("ros", "536.5713701935, 0. , 315", "1e400, 0. , 315", "finite"),
    ("ros", "camera_matrix:", "camera_matrix2:", "camera_matrix is missing"),
    ("ros", "image_height", "image_width", "stands twice"),
    ("opencv", "rows: 3\n   cols: 3", "rows: 3\n   cols: 4", "OpenCV cannot read it"),
    ("opencv", "dt: d", "dt: q", "OpenCV cannot read it"),
    ("opencv", "camera_matrix", "camera_mat", "camera_matrix is missing"),
    ("opencv", "image_width: 640", "image_width: abc", "image_width is None"),
    ("opencv", "flags: 2", "fisheye_model: 1", "fisheye_model has 5 coefficients"),
    ("opencv", "%YAML:1.0\n---\n", "", "OpenCV cannot read it"),
    ("kalibr", "camera_model: pinhole", "camera_model: omni", "camera_model is 'omni'"),
    ("kalibr", "radtan", "fov", "distortion_model is 'fov'"),
    ("kalibr", "resolution: [752, 480]", "resolution: 752", "cam0.resolution is 752"),
    ("kalibr", "[461.629, ", "[", "a list of 4 numbers is needed"),
    ("kalibr", "0.01779318", "0.51779318", "T_cam_imu is no rigid motion"),
    ("kalibr", "[0.0, 0.0, 0.0, 1.0]", "[0.0, 0.0, 0.0, 2.0]", "T_cam_imu is no rigid motion"),
    ("kalibr", "cam0:", "camera:", "holds no cam0"),
    ("mrcal", "OPENCV8", "SPLINED_STEREOGRAPHIC", "lens_model is"),
    ("mrcal", "1761.181055,", "", "a list of 12 numbers is needed"),
    ("mrcal", "1761.181055", "__import__('os')", "is no mrcal .cameramodel"),
    ("mrcal", "[ 4000, 2200 ]", "[ 4000 ]", "imagersize"),
    ("mrcal", "[ 2e-2", "[ 'a'", "extrinsics holds 'a'"),
    ("mrcal", "1761.181055", "1e999", "finite numbers"),
    ("colmap", "SIMPLE_RADIAL", "FOV", "the model is 'FOV'"),
    ("colmap", "-0.0218531", "", "7 cells, SIMPLE_RADIAL has 8"),
    ("colmap", "2559.69", "nan", "'nan' is no number"),
    ("colmap", "2559.69", "1e999999999", "is no number"),
    ("colmap", "3 SIMPLE_RADIAL 3072", "3 SIMPLE_RADIAL 3072.5", "the picture's side is 3072.5"),
    ("colmap", "3 SIMPLE", "4 SIMPLE", "holds no camera 3"),
]


@pytest.mark.parametrize(("name", "old", "new", "line"), WRONG)
def test_what_is_wrong_is_said(name: str, old: str, new: str, line: str, tmp_path: Path) -> None:
    path = tmp_path / "file.txt"
    text = SAMPLES[name].replace(old, new, 1)
    assert text != SAMPLES[name]
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        FORMATS[name].read(path, WHICH.get(name))
    assert line in str(refused.value)
    assert "file.txt" in str(refused.value)


@pytest.mark.parametrize("name", sorted(FORMATS))
@pytest.mark.parametrize(
    "data", [b"", b"\xff\xfe\x00", b"[" * 500, b"{" * 500, b"\0", b"%YAML:1.0\n---\n", b"1 2 3\n", b"# nothing\n"]
)
def test_rubbish_is_refused(name: str, data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(data)
    with pytest.raises(InputError):
        FORMATS[name].read(path, None)
    with pytest.raises(InputError):
        guessed(path)


@pytest.mark.parametrize("name", ["kalibr", "colmap"])
def test_of_several_cameras_one_must_be_named(name: str, tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text(SAMPLES[name])
    with pytest.raises(InputError, match="--camera"):
        FORMATS[name].read(path, None)
    with pytest.raises(InputError, match="holds no"):
        FORMATS[name].read(path, "cam9")


@settings(max_examples=150, deadline=None)
@given(
    name=st.sampled_from(sorted(SAMPLES)),
    where=st.integers(0, 1500),
    length=st.integers(0, 40),
    put=st.text(st.sampled_from("0123456789.-+e[]{}:,'\"\n #!&*%abn\\\0é"), max_size=12),
)
def test_a_damaged_file_is_read_or_refused_never_worse(name: str, where: int, length: int, put: str) -> None:
    text = SAMPLES[name]
    where %= len(text)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "file"
        path.write_text(text[:where] + put + text[where + length :], newline="")
        try:
            found = FORMATS[name].read(path, WHICH.get(name))
        except InputError:
            return
    assert found.camera.matrix[0, 0] > 0
