"""Videos: every frame, in order, the same from run to run."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from vbaa_calib.core.errors import InputError
from vbaa_calib.wizard.sources import Picture, Source, open_source

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


def frames(source: Source) -> list[Picture]:
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


def test_two_runs_give_the_same_bytes_and_seen_frames_are_left_out(video: Path) -> None:
    first = {each.name: each.sha256 for each in frames(open_source(str(video)))}
    again = {each.name: each.sha256 for each in frames(open_source(str(video), {"frame 0", "frame 7"}))}
    assert first.keys() - again.keys() == {"frame 0", "frame 7"}
    assert again.items() <= first.items()
    assert frames(open_source(str(video), first)) == []


@pytest.mark.parametrize("kept", [0, 300, 4000])
def test_a_video_that_cannot_be_read_is_refused(video: Path, tmp_path: Path, kept: int) -> None:
    path = tmp_path / "broken.avi"
    path.write_bytes(video.read_bytes()[:kept])
    with pytest.raises(InputError, match="not a video that can be read; record or copy it again"):
        open_source(str(path))


def test_a_video_that_is_cut_off_says_so(video: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "cut.avi"
    data = video.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    source = open_source(str(path))
    count = len(frames(source))
    assert 5 < count < FRAMES
    assert source.notes == (f"cut.avi is cut off or damaged: {count} of its {FRAMES} frames can be read",)
    assert capfd.readouterr() == ("", "")
