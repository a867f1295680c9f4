"""Pictures of every kind, whole and damaged."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.images import SUFFIXES, list_images, read_gray

GRAY = np.random.default_rng(0).integers(0, 256, (120, 160), np.uint8)
LOSSLESS = [suffix for suffix in SUFFIXES if not suffix.startswith(".jp")]


@pytest.mark.parametrize("suffix", LOSSLESS)
def test_a_gray_picture_comes_back_as_it_is(tmp_path: Path, suffix: str) -> None:
    cv2.imwrite(str(tmp_path / f"a{suffix}"), GRAY)
    np.testing.assert_array_equal(read_gray(tmp_path / f"a{suffix}"), GRAY)


def test_an_exif_rotation_is_not_applied(tmp_path: Path) -> None:
    """Else pictures of one camera held in two ways would be of two cameras."""
    entry = np.array([0x0112, 3, 1, 0, 6, 0], "<u2").tobytes()  # orientation: turned by 90°
    exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0" + entry + bytes(4)
    encoded = cv2.imencode(".jpg", GRAY)[1].tobytes()
    (tmp_path / "a.jpg").write_bytes(
        encoded[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + encoded[2:]
    )
    assert cv2.imread(str(tmp_path / "a.jpg"), cv2.IMREAD_GRAYSCALE).shape == GRAY.shape[::-1]
    assert read_gray(tmp_path / "a.jpg").shape == GRAY.shape


@pytest.mark.parametrize(
    "pixels",
    [
        np.dstack([GRAY] * 3),
        np.dstack([GRAY] * 4),
        GRAY.astype(np.uint16) * 257,
        np.dstack([GRAY.astype("u2") * 257] * 3),
    ],
    ids=["colour", "alpha", "16 bit", "16 bit colour"],
)
def test_colour_and_16_bits_become_gray_and_8_bits(tmp_path: Path, pixels: np.ndarray) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), pixels)
    np.testing.assert_array_equal(read_gray(tmp_path / "a.png"), GRAY)


def test_a_12_bit_sensor_in_a_16_bit_file_is_not_dark(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), GRAY.astype(np.uint16) * 16)
    assert np.abs(read_gray(tmp_path / "a.png").astype(int) - GRAY).max() <= 1


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("share", [0.0, 0.5, 0.98])
def test_a_truncated_picture_is_refused(
    tmp_path: Path, suffix: str, share: float, capfd: pytest.CaptureFixture
) -> None:
    path = tmp_path / f"cut{suffix}"
    cv2.imwrite(str(path), GRAY)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=f"cut{suffix}"):
        read_gray(path)
    assert capfd.readouterr().err == "", "the decoder must keep its own warnings to itself"


def test_a_png_with_a_flipped_byte_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), GRAY)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(InputError, match="truncated or damaged"):
        read_gray(path)


def test_a_jpeg_with_its_thumbnail_whole_but_itself_cut_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    cv2.imwrite(str(path), GRAY)
    whole = path.read_bytes()
    # the thumbnail is itself a complete JPEG, inside an APP1 segment
    data = whole[:2] + b"\xff\xe1" + (len(whole) + 2).to_bytes(2, "big") + whole + whole[2:]
    path.write_bytes(data)
    assert read_gray(path).shape == GRAY.shape
    path.write_bytes(data[:-200])
    with pytest.raises(InputError, match="truncated"):
        read_gray(path)


@pytest.mark.parametrize("content", [b"", b"hello", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"])
def test_what_is_no_picture_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.png"):
        read_gray(tmp_path / "a.png")


def test_folders_without_pictures_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("x")
    for path, words in ((tmp_path / "none", "no such folder"), (tmp_path, "holds no"), (tmp_path / "a.txt", "is not")):
        with pytest.raises(InputError, match=words):
            list_images(path)


def test_pictures_are_listed_by_name(tmp_path: Path) -> None:
    for name in ("b.PNG", "a.jpg", "c.txt", ".hidden.png"):
        (tmp_path / name).write_bytes(b"x")
    assert [path.name for path in list_images(tmp_path)] == ["a.jpg", "b.PNG"]
