"""Pictures of every kind, whole and damaged."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.images import SUFFIXES, as_levels, list_images, read_gray

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


@pytest.mark.parametrize("pattern", ["BG", "GB", "RG", "GR"])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_a_demosaiced_picture_has_what_was_measured_where_it_is_grey(pattern: str, kind: type) -> None:
    """Interpolated values move lines along rows; colours stay, and what is no linear demosaicing is left alone."""
    one = 1 if kind is np.uint8 else 16
    light = 128 - 60 * np.exp(-((np.arange(96)[:, None] - 41.3) ** 2) / 3)
    sampled = np.random.default_rng(1).normal(light * one, 3 * one, (96, 128)).round().astype(kind)
    demosaiced = getattr(cv2, f"COLOR_Bayer{pattern}2BGR")
    inside = (slice(1, -1), slice(1, -1))
    scale = 1.0 if one == 1 else 255.0 / 4095.0
    seen = as_levels(cv2.cvtColor(sampled, demosaiced))
    np.testing.assert_allclose(seen[inside], (sampled * scale)[inside], rtol=1e-6)
    red = cv2.cvtColor(sampled, demosaiced)
    red[48:64, 64:80, 2] //= 2
    seen = as_levels(red)
    np.testing.assert_allclose(seen[49:63, 65:79], red[49:63, 65:79] * scale, rtol=1e-6)
    np.testing.assert_allclose(seen[1:40, 1:60, 0], (sampled * scale)[1:40, 1:60], rtol=1e-6)
    blurred = cv2.GaussianBlur(cv2.cvtColor(sampled, demosaiced), (3, 3), 0)
    assert as_levels(blurred).ndim == 3


def test_pictures_are_listed_by_name(tmp_path: Path) -> None:
    for name in ("b.PNG", "a.jpg", "c.txt", ".hidden.png"):
        (tmp_path / name).write_bytes(b"x")
    assert [path.name for path in list_images(tmp_path)] == ["a.jpg", "b.PNG"]


def test_pictures_of_other_kinds_are_named(tmp_path: Path) -> None:
    """A phone's or a camera's raw ones, beside others or alone; not where the same picture is there in a kind that is
    read."""
    for name in ("a.jpg", "a.dng", "b.HEIC"):
        (tmp_path / name).write_bytes(b"x")
    with pytest.raises(InputError, match=r"1 pictures are \.heic"):
        list_images(tmp_path)
    (tmp_path / "b.png").write_bytes(b"x")
    assert [path.name for path in list_images(tmp_path)] == ["a.jpg", "b.png"]
