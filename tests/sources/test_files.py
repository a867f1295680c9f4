"""Pictures out of a folder that is being filled, and the frames of a video."""

from __future__ import annotations

import hashlib
import os
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from vbaa_calib.core.images import read_gray
from vbaa_calib.sources import Picture, PictureSource, open_source
from vbaa_calib.sources.files import FolderSettings, FolderSource

QUICK = FolderSettings(scan_s=0.02, steady_s=0.05, patience_s=0.25)


def picture(seed: int, suffix: str = ".png") -> bytes:
    noise = np.random.default_rng(seed).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    return cv2.imencode(suffix, cv2.GaussianBlur(noise, (0, 0), 2))[1].tobytes()


def put(path: Path, data: bytes, age_s: float = 3600.0) -> None:
    path.write_bytes(data)
    os.utime(path, (time.time() - age_s,) * 2)


def test_pictures_come_by_name_as_their_own_bytes(tmp_path: Path) -> None:
    for name, suffix in (("b.PNG", ".png"), ("a10.jpg", ".jpg"), ("a9.tif", ".tif"), ("c.bmp", ".bmp")):
        put(tmp_path / name, picture(len(name), suffix))
    (tmp_path / "notes.txt").write_text("no picture")
    (tmp_path / "d.png").mkdir()
    put(tmp_path / "d.png" / "inside.png", picture(1))
    source = open_source(str(tmp_path))
    assert (source.live, source.ended) == (False, False)
    for name in ("a10.jpg", "a9.tif", "b.PNG", "c.bmp"):
        offered = source.next(1.0)
        data = (tmp_path / name).read_bytes()
        assert (offered.name, offered.data, offered.time_s) == (name, data, None)
        assert offered.suffix == Path(name).suffix.lower()
        assert offered.sha256 == hashlib.sha256(data).hexdigest()
        np.testing.assert_array_equal(offered.image, read_gray(tmp_path / name))
    assert source.ended
    assert source.next(0.0) is None
    assert source.notes == ()


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".tif"])
def test_a_picture_is_offered_only_when_it_is_written_whole(tmp_path: Path, suffix: str) -> None:
    data, path = picture(5, suffix), tmp_path / f"x{suffix}"
    source = FolderSource(tmp_path, wait=True, pace=QUICK)

    def write() -> None:
        with path.open("wb", buffering=0) as stream:
            for part in range(0, len(data), len(data) // 8):
                stream.write(data[part : part + len(data) // 8])
                time.sleep(0.03)

    writer = threading.Thread(target=write)
    writer.start()
    offered = source.next(3.0)
    writer.join()
    assert offered.data == data
    assert source.notes == ()


@pytest.mark.parametrize("data", [b"", picture(4)[:-30]])
def test_a_broken_picture_is_told_once_and_offered_when_mended(tmp_path: Path, data: bytes) -> None:
    put(tmp_path / "bad.png", data)
    put(tmp_path / "good.png", picture(1))
    source = FolderSource(tmp_path, wait=True, pace=QUICK)
    assert [offered and offered.name for offered in (source.next(0.5), source.next(0.5), source.next(0.3))] == [
        "good.png",
        None,
        None,
    ]
    (note,) = source.notes
    assert note.startswith("bad.png: ")
    put(tmp_path / "bad.png", picture(2), age_s=0)
    assert source.next(2.0).name == "bad.png"


FRAMES = 25


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("video") / "with:colon %02d.avi"
    writer = cv2.VideoWriter(str(path), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (320, 240))
    grain = np.random.default_rng(1).integers(0, 60, (240, 320, 3), dtype=np.uint8)
    for index in range(FRAMES):
        writer.write(grain + np.uint8(7 * index))
    writer.release()
    return path


def frames(source: PictureSource) -> list[Picture]:
    found = []
    while not source.ended:
        offered = source.next(0.5)
        if offered is not None:
            found.append(offered)
    return found


def test_every_frame_comes_in_order_with_its_time(video: Path) -> None:
    source = open_source(str(video))
    assert source.live
    found = frames(source)
    assert [each.name for each in found] == [f"frame {index}" for index in range(FRAMES)]
    assert [each.time_s for each in found] == pytest.approx([index / 10 for index in range(FRAMES)], abs=1e-3)
    grey = [each.image.mean() for each in found]
    np.testing.assert_allclose(np.diff(grey), 7, atol=1)
    assert source.next(0.0) is None
    assert source.notes == ()


def test_a_video_that_is_cut_off_says_so(video: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "cut.avi"
    data = video.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    source = open_source(str(path))
    count = len(frames(source))
    assert 5 < count < FRAMES
    assert source.notes == (f"cut.avi is cut off or damaged: {count} of its {FRAMES} frames can be read",)
    assert capfd.readouterr() == ("", "")
