"""The ChArUco board as the user describes it, checked once."""

from __future__ import annotations

from dataclasses import asdict, field
from typing import Annotated, Any, Literal

import cv2
import numpy as np
import yaml
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

DICTIONARY_SIZES = (50, 100, 250, 1000)
DICTIONARIES = tuple(f"DICT_{bits}X{bits}_{size}" for bits in (4, 5, 6, 7) for size in DICTIONARY_SIZES)

_Squares = Annotated[int, Field(strict=True, ge=2, le=200)]
_Side = Annotated[float, Field(strict=True, gt=0, lt=10)]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class BoardSpec:
    """A ChArUco board. Board frame = OpenCV's: origin at the outline's first corner, z away from the viewer.

    Attributes
    ----------
    squares_x, squares_y : squares along x and y (columns, rows).
    square_m, marker_m : side lengths, m.
    dictionary : name of OpenCV's predefined dictionary.
    legacy_pattern : the layout that OpenCV printed before 4.6 for an even number of rows.
    thickness_m : distance from the printed face to the face that rests in the jig.

    Raises pydantic's ValidationError, a ValueError, for what is no board.
    """

    squares_x: _Squares
    squares_y: _Squares
    square_m: _Side
    marker_m: _Side
    dictionary: str = "DICT_4X4_100"
    legacy_pattern: Annotated[bool, Field(strict=True)] = False
    thickness_m: Annotated[float, Field(strict=True, ge=0, lt=10)] = 0.0
    type: Literal["charuco"] = field(default="charuco", kw_only=True, repr=False)

    def __post_init__(self) -> None:
        if not self.marker_m < self.square_m:
            exchanged = f" (exchanged? square_m: {self.marker_m!r}, marker_m: {self.square_m!r} would do)"
            raise ValueError(
                f"marker_m is {self.marker_m!r} and square_m {self.square_m!r}: 0 < marker_m < square_m is needed"
                + (exchanged if self.marker_m > self.square_m else "")
            )
        if self.dictionary not in DICTIONARIES:
            raise ValueError(f"dictionary is {self.dictionary!r}: one of {', '.join(DICTIONARIES)} is needed")
        available = int(self.dictionary.rsplit("_", 1)[1])
        if self.marker_count > available:
            squares = f"{self.squares_x}x{self.squares_y} squares"
            raise ValueError(f"{squares} need {self.marker_count} markers, {self.dictionary} has {available}")

    @property
    def corner_count(self) -> int:
        return (self.squares_x - 1) * (self.squares_y - 1)

    @property
    def marker_count(self) -> int:
        return self.squares_x * self.squares_y // 2

    @property
    def modules(self) -> int:
        """Cells along a marker's side, its black border included."""
        return int(self.dictionary[len("DICT_")]) + 2

    @property
    def starts_with_marker(self) -> bool:
        """Whether the first square holds a marker: in the legacy pattern with an even number of rows."""
        return self.legacy_pattern and self.squares_y % 2 == 0

    def to_dict(self) -> dict[str, Any]:
        """The mapping `board` of session.yaml, or a board.yaml."""
        return {"type": self.type, **asdict(self)}


def opencv_board(spec: BoardSpec) -> cv2.aruco.CharucoBoard:
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, spec.dictionary))
    board = cv2.aruco.CharucoBoard((spec.squares_x, spec.squares_y), spec.square_m, spec.marker_m, dictionary)
    board.setLegacyPattern(spec.legacy_pattern)
    return board


def corner_points(spec: BoardSpec) -> np.ndarray:
    """(corner_count, 3) inner corners in the board frame, m, in the order of OpenCV's corner ids."""
    return np.asarray(opencv_board(spec).getChessboardCorners(), float).reshape(-1, 3)


def spec_line(spec: BoardSpec) -> str:
    """The specification as one line of YAML: what the QR code holds, and a board.yaml as it stands."""
    return yaml.safe_dump(spec.to_dict(), default_flow_style=True, sort_keys=False, width=10**6).strip()
