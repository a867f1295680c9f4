"""Specifications of calibration boards, checked once: ChArUco, AprilGrid, chessboard or grid of circles."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import asdict, field
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import ConfigDict, Discriminator, Field, Tag, model_validator
from pydantic.dataclasses import dataclass

if TYPE_CHECKING:
    import cv2  # slow to load

DICTIONARY_SIZES = (50, 100, 250, 1000)
DICTIONARIES = {f"DICT_{bits}X{bits}_{size}": size for bits in (4, 5, 6, 7) for size in DICTIONARY_SIZES} | {
    "DICT_ARUCO_ORIGINAL": 1024,
    "DICT_ARUCO_MIP_36h12": 250,
    "DICT_APRILTAG_16h5": 30,
    "DICT_APRILTAG_25h9": 35,
    "DICT_APRILTAG_36h10": 2320,
    "DICT_APRILTAG_36h11": 587,
}
"""OpenCV's dictionaries, and how many markers each has."""

_Squares = Annotated[int, Field(strict=True, ge=2, le=200)]
_ChessCount = Annotated[int, Field(strict=True, ge=4, le=200)]
_GridCount = Annotated[int, Field(strict=True, ge=3, le=50)]
_Side = Annotated[float, Field(strict=True, gt=0, lt=10)]
_Id = Annotated[int, Field(strict=True, ge=0, le=9999)]


class _OfSquares:
    """Size and number of inner corners of a board of squares (mixin of `BoardSpec` and `Chessboard`)."""

    squares_x: int
    squares_y: int
    square_m: float

    @property
    def pitch_m(self) -> float:
        """Distance of neighbouring corners."""
        return self.square_m

    @property
    def size_m(self) -> tuple[float, float]:
        """(along x, along y) of the print."""
        return self.square_m * self.squares_x, self.square_m * self.squares_y

    @property
    def outline_m(self) -> np.ndarray:
        """(4, 2) corners of the print in the board frame, clockwise from the upper left."""
        return _outline(self.size_m)

    @property
    def corner_columns(self) -> int:
        """Number of corners in a row."""
        return self.squares_x - 1

    @property
    def corner_count(self) -> int:
        return (self.squares_x - 1) * (self.squares_y - 1)


@dataclass(frozen=True, config=ConfigDict(extra="forbid", defer_build=True))
class BoardSpec(_OfSquares):
    """A ChArUco board. Board frame = OpenCV's: origin at the outline's first corner, z away from the viewer.

    Attributes
    ----------
    squares_x, squares_y : squares along x and y (columns, rows).
    square_m, marker_m : side lengths, m.
    dictionary : name of OpenCV's predefined dictionary.
    legacy_pattern : the layout that OpenCV printed before 4.6 for an even number of rows.
    thickness_m : distance from the printed face to the face that rests in the jig.
    stretch, stretch_std : by how much the print is longer along x than along y, relative, where both rulers were
        measured; `square_m` is then the mean of a square's sides.
    first_id, ids : the markers' ids, row by row: from `first_id` on, or as they are listed.

    Raises pydantic's ValidationError, a ValueError, for an impossible board.
    """

    squares_x: _Squares
    squares_y: _Squares
    square_m: _Side
    marker_m: _Side
    dictionary: str = "DICT_4X4_100"
    legacy_pattern: Annotated[bool, Field(strict=True)] = False
    thickness_m: Annotated[float, Field(strict=True, ge=0, lt=10)] = 0.0
    stretch: Annotated[float, Field(strict=True, gt=-0.3, lt=0.3)] = 0.0
    stretch_std: Annotated[float, Field(strict=True, gt=0, lt=0.1)] | None = None
    first_id: _Id = 0
    ids: tuple[_Id, ...] | None = None
    type: Literal["charuco"] = field(default="charuco", kw_only=True, repr=False)

    @model_validator(mode="before")
    @classmethod
    def _has_ids(cls, data: Any) -> Any:
        kind = data.get("type") if isinstance(data, Mapping) else None
        if isinstance(kind, str) and kind != "charuco":
            what, remedy = f"is {kind!r}", "charuco or aprilgrid is needed here"
            if kind in BOARDS:
                what += ": its marks have no ids, so the board's pose is ambiguous"
                remedy = "take a ChArUco board or an AprilGrid; `vbaa intrinsics` takes that one for the lens alone"
            raise ValueError(what, remedy, "type")
        return data

    def __post_init__(self) -> None:
        _require_std(self.stretch, self.stretch_std)
        if not self.marker_m < self.square_m:
            exchanged = f" (exchanged? square_m: {self.marker_m!r}, marker_m: {self.square_m!r} would do)"
            raise ValueError(
                f"marker_m is {self.marker_m!r} and square_m {self.square_m!r}: 0 < marker_m < square_m is needed"
                + (exchanged if self.marker_m > self.square_m else "")
            )
        if self.ids is not None:
            if len(set(self.ids)) != len(self.ids) or len(self.ids) != self.marker_count:
                needed = f"{self.marker_count} different ones are needed for {self.squares_x}x{self.squares_y} squares"
                raise ValueError(f"ids are {len(self.ids)}, {len(set(self.ids))} of them different: {needed}")
            if self.first_id:
                raise ValueError(f"first_id is {self.first_id!r} and ids are listed: leave one out")
        _require_markers(self.dictionary, self.marker_ids, f"{self.squares_x}x{self.squares_y} squares")

    @property
    def marker_count(self) -> int:
        return self.squares_x * self.squares_y // 2

    @property
    def marker_ids(self) -> np.ndarray:
        """(marker_count,) ids row by row."""
        return self.first_id + np.arange(self.marker_count) if self.ids is None else np.array(self.ids)

    @property
    def modules(self) -> int:
        """Cells along a marker's side, its black border included."""
        return int(_dictionary(self.dictionary).markerSize) + 2

    @property
    def has_one_reading(self) -> bool:
        """Whether a picture of the whole board identifies the corners: always, by the markers."""
        return True

    @property
    def starts_with_marker(self) -> bool:
        """Whether the first square contains a marker: in the legacy pattern with an even number of rows."""
        return self.legacy_pattern and self.squares_y % 2 == 0

    def to_dict(self) -> dict[str, Any]:
        """The mapping `board` of session.yaml, or of a board.yaml."""
        described = _described({"type": self.type, **asdict(self)})
        listed = described.pop("ids")
        return described if listed is None else described | {"ids": list(listed)}


@dataclass(frozen=True, config=ConfigDict(extra="forbid", defer_build=True))
class Chessboard(_OfSquares):
    """A chessboard without markers, for the lens. Board frame as of a ChArUco board; the square at its origin is black.

    squares_x, squares_y : all squares along x and y, the outer ones too. square_m : side, m.
    """

    type: Literal["chessboard"]
    squares_x: _ChessCount
    squares_y: _ChessCount
    square_m: _Side

    @property
    def has_one_reading(self) -> bool:
        """Whether a picture of the whole board identifies the corners, by the one with a black square."""
        return (self.squares_x + self.squares_y) % 2 == 1

    @property
    def lattice(self) -> np.ndarray:
        """(corner_count, 2) column and row of each inner corner, in squares from the board's outline."""
        return _lattice(self.squares_x - 1, self.squares_y - 1) + 1

    def to_dict(self) -> dict[str, Any]:
        """The content of board.yaml."""
        return asdict(self)


@dataclass(frozen=True, config=ConfigDict(extra="forbid", defer_build=True))
class CircleGrid:
    """Dark circles on white, or white ones on dark, for the lens: OpenCV's symmetric or asymmetric grid.

    Board frame: origin at the first circle's centre, x along its row, z away from the viewer.

    type : circles stand in columns and rows; asymmetric_circles have every second row moved by half a step.
    columns : circles in a row. rows : rows.
    spacing_m : distance of neighbouring circles in a row; of an asymmetric grid that of neighbouring rows, which is
        half of that in a row.
    """

    type: Literal["circles", "asymmetric_circles"]
    columns: _GridCount
    rows: _GridCount
    spacing_m: _Side

    @property
    def has_one_reading(self) -> bool:
        """Whether a picture of the whole board identifies the circles, by the board's shape."""
        return self.type == "asymmetric_circles" and self.rows % 2 == 1

    @property
    def lattice(self) -> np.ndarray:
        """(corner_count, 2) coordinates of each circle, in spacings from the first one."""
        places = _lattice(self.columns, self.rows)
        if self.type == "asymmetric_circles":
            places[:, 0] = 2 * places[:, 0] + places[:, 1] % 2
        return places

    @property
    def pitch_m(self) -> float:
        """Distance of neighbouring circles."""
        return self.spacing_m * (float(np.sqrt(2.0)) if self.type == "asymmetric_circles" else 1.0)

    @property
    def corner_count(self) -> int:
        return self.columns * self.rows

    def to_dict(self) -> dict[str, Any]:
        """The content of board.yaml."""
        return asdict(self)


@dataclass(frozen=True, config=ConfigDict(extra="forbid", defer_build=True))
class AprilGrid:
    """Kalibr's AprilGrid: tags in columns and rows, with black squares at their corners.

    Board frame: origin at the upper left corner of the upper left tag, x along its row, y down, z away from the viewer.
    Corners are numbered along the lines of corners from there; tags from the lower left one, row by row upwards.

    columns, rows : tags. tag_m : side of a tag, m. spacing : width of the gap between tags, in sides of a tag.
    border : modules of black around a tag's bits. first_id : of the lower left tag.
    thickness_m, stretch, stretch_std : as of a `BoardSpec`, `tag_m` in place of `square_m`.
    """

    type: Literal["aprilgrid"]
    columns: Annotated[int, Field(strict=True, ge=1, le=50)]
    rows: Annotated[int, Field(strict=True, ge=1, le=50)]
    tag_m: _Side
    spacing: Annotated[float, Field(strict=True, ge=0.05, le=1)]
    dictionary: str = "DICT_APRILTAG_36h11"
    border: Annotated[int, Field(strict=True, ge=1, le=2)] = 2
    first_id: _Id = 0
    thickness_m: Annotated[float, Field(strict=True, ge=0, lt=10)] = 0.0
    stretch: Annotated[float, Field(strict=True, gt=-0.3, lt=0.3)] = 0.0
    stretch_std: Annotated[float, Field(strict=True, gt=0, lt=0.1)] | None = None

    def __post_init__(self) -> None:
        _require_std(self.stretch, self.stretch_std)
        _require_markers(self.dictionary, self.marker_ids, f"{self.columns}x{self.rows} tags")

    @property
    def has_one_reading(self) -> bool:
        """Whether a picture of the whole board identifies the corners: always, by the tags."""
        return True

    @property
    def marker_ids(self) -> np.ndarray:
        """(rows · columns,) ids, row by row from the upper left tag."""
        rows = np.arange(self.rows * self.columns).reshape(self.rows, self.columns)
        return self.first_id + rows[::-1].ravel()

    @property
    def modules(self) -> int:
        """Cells along a tag's side, its black border included."""
        return int(_dictionary(self.dictionary).markerSize) + 2 * self.border

    @property
    def size_m(self) -> tuple[float, float]:
        """(along x, along y) of the print, with the squares at its rim."""
        across, down = (self.tag_m * (count + (count + 1) * self.spacing) for count in (self.columns, self.rows))
        return across, down

    @property
    def outline_m(self) -> np.ndarray:
        """(4, 2) corners of the print, its rim's squares included, in the board frame, clockwise from upper left."""
        return _outline(self.size_m) - self.pitch_m

    @property
    def starts_with_marker(self) -> bool:
        """Whether the print begins with a marker: no, the border begins with a black square."""
        return False

    @property
    def pitch_m(self) -> float:
        """Smallest distance of neighbouring corners."""
        return self.tag_m * self.spacing

    @property
    def corner_columns(self) -> int:
        """Number of corners in a row."""
        return 2 * self.columns

    @property
    def corner_count(self) -> int:
        return 4 * self.columns * self.rows

    @property
    def lattice(self) -> np.ndarray:
        """(corner_count, 2) coordinates of each corner, in sides of a tag from the first one."""
        step = _lattice(2 * self.columns, 2 * self.rows)
        return step // 2 * (1.0 + self.spacing) + step % 2

    def to_dict(self) -> dict[str, Any]:
        """The content of board.yaml."""
        described = _described(asdict(self))
        if not self.thickness_m:
            del described["thickness_m"]
        return described

    def drawing(self, tag_px: int) -> np.ndarray:
        """The print as (H, W) uint8, 0 black and 255 white, with gaps rounded to whole pixels.

        tag_px : side of a tag, a multiple of `modules`. Kalibr's tags are turned by half against OpenCV's.
        """
        import cv2

        gap_px = round(self.spacing * tag_px)
        across, down = (count * (tag_px + gap_px) + gap_px for count in (self.columns, self.rows))
        drawn = np.full((down, across), 255, np.uint8)
        corners = (np.arange(count + 1) * (tag_px + gap_px) for count in (self.rows, self.columns))
        rows, columns = ((starts[:, None] + np.arange(gap_px)).ravel() for starts in corners)
        drawn[np.ix_(rows, columns)] = 0
        for index, number in enumerate(self.marker_ids.tolist()):
            y, x = (gap_px + place * (tag_px + gap_px) for place in divmod(index, self.columns))
            tag = cv2.aruco.generateImageMarker(_dictionary(self.dictionary), number, tag_px, borderBits=self.border)
            drawn[y : y + tag_px, x : x + tag_px] = np.rot90(tag, 2)
        return drawn


def _tag(board: Any) -> str:
    kind = board.get("type") if isinstance(board, Mapping) else getattr(board, "type", None)
    return "<AprilGrid>" if kind == "aprilgrid" else "<BoardSpec>"


BoardWithIds = BoardSpec | AprilGrid
"""What shows which corner is which wherever a part of it is seen: the boards of sessions."""
FileBoard = Annotated[
    Annotated[BoardSpec, Tag("<BoardSpec>")] | Annotated[AprilGrid, Tag("<AprilGrid>")], Discriminator(_tag)
]
"""The same as a file describes it, by its type; a ChArUco board where none is named."""
Board = BoardWithIds | Chessboard | CircleGrid
"""What the lens can be calibrated with."""
BOARDS: dict[str, type[Board]] = {
    "charuco": BoardSpec,
    "aprilgrid": AprilGrid,
    "chessboard": Chessboard,
    "circles": CircleGrid,
    "asymmetric_circles": CircleGrid,
}
"""The kinds of boards, by `type`."""


@dataclasses.dataclass(frozen=True, eq=False)
class BoardPoints:
    """A board known only by its points (K, 3) m in its frame, with z = 0 except for its deformation."""

    points_m: np.ndarray

    @property
    def pitch_m(self) -> float:
        """Distance of neighbouring points."""
        return float(np.sort(np.linalg.norm(self.points_m - self.points_m[0], axis=1))[1])


def _outline(size_m: tuple[float, float]) -> np.ndarray:
    return np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * size_m


def _lattice(columns: int, rows: int) -> np.ndarray:
    row, column = np.mgrid[:rows, :columns]
    return np.stack([column.ravel(), row.ravel()], axis=1)


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    import cv2

    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def _require_std(stretch: float, stretch_std: float | None) -> None:
    if stretch and stretch_std is None:
        raise ValueError(f"stretch is {stretch!r} without stretch_std: how well both rulers were read is needed")


def _described(fields: dict[str, Any]) -> dict[str, Any]:
    """The fields of a board, without those that are usually at their defaults."""
    usual = {name for name in ("stretch", "stretch_std") if fields["stretch_std"] is None}
    usual |= set() if fields["first_id"] else {"first_id"}
    return {name: value for name, value in fields.items() if name not in usual}


def _require_markers(dictionary: str, ids: np.ndarray, what: str) -> None:
    if dictionary not in DICTIONARIES:
        raise ValueError(f"dictionary is {dictionary!r}: one of {', '.join(DICTIONARIES)} is needed")
    if ids.max() >= DICTIONARIES[dictionary]:
        needed = f"{what} need {len(ids)} markers"
        needed += f" with ids up to {ids.max()}" if ids.max() >= len(ids) else ""
        raise ValueError(f"{needed}, {dictionary} has {DICTIONARIES[dictionary]}")


def opencv_board(spec: BoardSpec) -> cv2.aruco.CharucoBoard:
    import cv2

    size, ids = (spec.squares_x, spec.squares_y), spec.marker_ids.astype(np.int32)
    board = cv2.aruco.CharucoBoard(size, spec.square_m, spec.marker_m, _dictionary(spec.dictionary), ids)
    board.setLegacyPattern(spec.legacy_pattern)
    return board


def corner_points(spec: Board | BoardPoints) -> np.ndarray:
    """(corner_count, 3) inner corners, or circles' centres, in the board frame, m, in the order of OpenCV's ids."""
    if isinstance(spec, BoardPoints):
        return spec.points_m
    if not isinstance(spec, BoardSpec):
        step = {Chessboard: "square_m", AprilGrid: "tag_m", CircleGrid: "spacing_m"}[type(spec)]
        return np.pad(getattr(spec, step) * spec.lattice, ((0, 0), (0, 1)))
    return np.asarray(opencv_board(spec).getChessboardCorners(), float).reshape(-1, 3)


def spec_line(spec: Board) -> str:
    """The specification as one line of YAML, for the QR code; it is a valid board.yaml."""
    return yaml.safe_dump(spec.to_dict(), default_flow_style=True, sort_keys=False, width=10**6).strip()
