"""A bag or video in pieces shows bit for bit what it shows as a whole."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from estimator import ContactEstimator
from estimator.contact.estimate import STREAM
from estimator.contact.pieces import look
from estimator.contact.source import Indivisible, Source, Stream, StreamOptions, open_source
from vbaa_calib.streams import Timing
from vbaa_calib.streams.bags import Topics

from .recordings import COUNT, rig, write

LENGTH = 200


def stream(path: Path, **options: object) -> Stream:
    found = open_source(path, rig(), options=StreamOptions(**options)).stream  # type: ignore[arg-type]
    assert found is not None
    return pickle.loads(pickle.dumps(found))  # another process opens it


def video(path: Path, code: str) -> Path:
    """Moving noise, so that every frame differs, of the rig's size; with readings beside it."""
    width, height = rig().camera.image_size
    rng, writer = (
        np.random.default_rng(0),
        cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), 30.0, (width, height)),
    )
    small = rng.integers(0, 256, (height // 8, width // 8 + LENGTH), np.uint8)
    for index in range(LENGTH):
        part = cv2.resize(small[:, index : index + width // 8], (width, height))
        writer.write(cv2.cvtColor(part, cv2.COLOR_GRAY2BGR))
    writer.release()
    rows = "".join(f"{index / 30.0:.6f},{0.001 * index:.6f},0,0\n" for index in range(LENGTH))
    path.with_suffix(".csv").write_text("time_s,moment_Nm,pan_rad,tilt_rad\n" + rows)
    return path


@pytest.mark.parametrize("name", ["a.mcap", "a.bag", "a", "MJPG.avi", "mp4v.mp4"])
def test_skimming_finds_every_frame_and_its_picture_again(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    write(path) if path.suffix[1:] in ("mcap", "bag", "") else video(path, path.stem)
    one = stream(path, topics=Topics(camera="none"), timing=Timing(offset_s=0.013))
    whole = list(one.taken())
    frames, places = one.skimmed()
    assert [str(frame) for frame in frames] == [str(frame) for frame, _ in whole]
    assert len(whole) == (COUNT if path.suffix[1:] in ("mcap", "bag", "") else LENGTH)
    for part in (slice(0, 3), slice(7, 9), slice(66, None)):
        again = list(one.pictures(frames[part], places[part]))
        assert [frame.frame for frame, _ in again] == [frame.frame for frame in frames[part]]
        assert all(np.array_equal(a, b) for (_, a), (_, b) in zip(again, whole[part], strict=True))


def test_pieces_of_a_bag_show_what_the_whole_shows(tmp_path: Path) -> None:
    source = open_source(write(tmp_path / "a.mcap"), rig())
    estimator = ContactEstimator(rig())
    whole, skimmed = look(estimator, source), source.skimmed()
    parts = [look(estimator, skimmed.cut(slice(begin, min(begin + STREAM, COUNT)))) for begin in (0, STREAM)]
    before = [frame for frame, _ in skimmed.cut(slice(STREAM + 1, COUNT)).earlier()]
    assert before == list(skimmed.frames[: STREAM + 1][::-1])
    reasons = [reason for part in parts for reason in part.reasons]
    assert reasons == whole.reasons
    for own, other in zip([each for part in parts for each in part.measured], whole.measured, strict=True):
        assert all(
            np.array_equal(a, b, equal_nan=True) for a, b in zip(vars(own).values(), vars(other).values(), strict=True)
        )


def test_a_damaged_picture_in_a_piece_is_not_passed_over(tmp_path: Path) -> None:
    """As a whole it is left out, and the frames after it have other numbers: so it must be read as a whole."""
    source: Source = open_source(write(tmp_path / "a.mcap", {5: np.zeros(100, np.uint8)}), rig()).skimmed()
    assert source.stream is not None
    with pytest.raises(Indivisible):
        list(source.stream.pictures(source.frames[4:8], source.places[4:8]))
    wrong = [replace(frame, time_s=frame.time_s + 0.1) for frame in source.frames[:2]]
    with pytest.raises(Indivisible):
        list(source.stream.pictures(wrong, source.places[:2]))
