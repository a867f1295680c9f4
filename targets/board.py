"""The ChArUco board as the user describes it, checked once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np

DICTIONARY_SIZES = (50, 100, 250, 1000)
DICTIONARIES = tuple(f"DICT_{bits}X{bits}_{size}" for bits in (4, 5, 6, 7) for size in DICTIONARY_SIZES)


@dataclass(frozen=True)
class BoardSpec:
    """A ChArUco board. Board frame = OpenCV's: origin at the outline's first corner, z away from the viewer.

    Attributes
    ----------
    squares_x, squares_y : squares along x and y (columns, rows).
    square_m, marker_m : side lengths, m.
    dictionary : name of OpenCV's predefined dictionary.
    legacy_pattern : the layout that OpenCV printed before 4.6 for an even number of rows.
    thickness_m : distance from the printed face to the face that rests in the jig.
    """

    squares_x: int
    squares_y: int
    square_m: float
    marker_m: float
    dictionary: str = "DICT_4X4_100"
    legacy_pattern: bool = False
    thickness_m: float = 0.0

    def __post_init__(self) -> None:
        for name in ("squares_x", "squares_y"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or not 2 <= value <= 200:
                raise ValueError(f"{name} is {value!r}: a whole number from 2 to 200 is needed")
        for name in ("square_m", "marker_m", "thickness_m"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < 10:
                raise ValueError(f"{name} is {value!r}: a length in metres is needed")
        if not 0 < self.marker_m < self.square_m:
            exchanged = f" (exchanged? square_m: {self.marker_m!r}, marker_m: {self.square_m!r} would do)"
            raise ValueError(
                f"marker_m is {self.marker_m!r} and square_m {self.square_m!r}: 0 < marker_m < square_m is needed"
                + (exchanged if self.marker_m > self.square_m > 0 else "")
            )
        if self.dictionary not in DICTIONARIES:
            raise ValueError(f"dictionary is {self.dictionary!r}: one of {', '.join(DICTIONARIES)} is needed")
        if not isinstance(self.legacy_pattern, bool):
            raise ValueError(f"legacy_pattern is {self.legacy_pattern!r}: true or false is needed")
        markers, available = self.squares_x * self.squares_y // 2, int(self.dictionary.rsplit("_", 1)[1])
        if markers > available:
            raise ValueError(
                f"{self.squares_x}x{self.squares_y} squares need {markers} markers, {self.dictionary} has {available}"
            )

    @property
    def corner_count(self) -> int:
        """Number of inner chessboard corners."""
        return (self.squares_x - 1) * (self.squares_y - 1)

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> BoardSpec:
        """From the `board:` mapping of session.yaml or a board.yaml. Raises ValueError saying which key is wrong."""
        if not isinstance(data, Mapping):
            raise ValueError("a mapping with type, squares_x, squares_y, square_m, marker_m is needed")
        fields = dict(data)
        if fields.pop("type", "charuco") != "charuco":
            raise ValueError("type must be charuco")
        known = BoardSpec.__dataclass_fields__
        for name in fields:
            if name not in known:
                raise ValueError(f"unknown key {name!r}: the keys are type, {', '.join(known)}")
        for name in ("squares_x", "squares_y", "square_m", "marker_m"):
            if name not in fields:
                raise ValueError(f"the key {name} is missing")
        return BoardSpec(**fields)

    def to_dict(self) -> dict[str, Any]:
        """The mapping that `from_dict` reads."""
        return {"type": "charuco", **asdict(self)}


def opencv_board(spec: BoardSpec) -> cv2.aruco.CharucoBoard:
    """OpenCV's board object for a spec."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, spec.dictionary))
    board = cv2.aruco.CharucoBoard((spec.squares_x, spec.squares_y), spec.square_m, spec.marker_m, dictionary)
    board.setLegacyPattern(spec.legacy_pattern)
    return board


def corner_points(spec: BoardSpec) -> np.ndarray:
    """(corner_count, 3) inner corners in the board frame, m, in the order of OpenCV's corner ids."""
    return np.asarray(opencv_board(spec).getChessboardCorners(), float).reshape(-1, 3)
