"""The real photo sets: where they are, what board they show, detected once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

from targets.board import BoardSpec
from vbaa_calib.detect.board.corners import BoardView, detect_folder

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
_UCL = BoardSpec(19, 26, 0.005, 0.004, "DICT_4X4_250", legacy_pattern=True)


@dataclass(frozen=True)
class PhotoSet:
    """Folder and board of a set."""

    folder: Path
    spec: BoardSpec


SETS = {
    "realsense": PhotoSet(
        DATA / "realsense_doosan_charuco" / "intrinsics_images", BoardSpec(7, 5, 0.03, 0.022, "DICT_4X4_50")
    ),
    "gopro": PhotoSet(DATA / "pycalib_gopro_charuco", BoardSpec(18, 9, 0.02, 0.015, "DICT_4X4_250")),
    "ucl_left": PhotoSet(DATA / "ucl_axis_tests_charuco" / "ExtractedFrames_L", _UCL),
    "ucl_right": PhotoSet(DATA / "ucl_axis_tests_charuco" / "ExtractedFrames_R", _UCL),
}


def photo_set(name: str) -> PhotoSet:
    """A set, or a skip where the data is absent."""
    if not SETS[name].folder.is_dir():
        pytest.skip(f"the photo set {name} is not at {SETS[name].folder}")
    return SETS[name]


@cache
def _detected(name: str) -> tuple[BoardView, ...]:
    return tuple(detect_folder(SETS[name].folder, SETS[name].spec))


def detected(name: str) -> tuple[list[BoardView], BoardSpec]:
    """Views and board of a set, or a skip where the data is absent."""
    return list(_detected(name)) if photo_set(name) else [], SETS[name].spec
