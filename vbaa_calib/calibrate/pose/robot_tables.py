"""Tables for a hand-eye calibration: the robot's poses, and corners that another program has detected."""

from __future__ import annotations

import math
from itertools import permutations
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from vbaa_calib.core.csv_rows import header_of, number, read_csv, whole_number
from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Pose

from .settings import HandEyeSettings

_PLACES = {("x_m", "y_m", "z_m"): 1.0, ("x_mm", "y_mm", "z_mm"): 1e-3}  # columns, and metres of their unit
_ANGLES = {(f"a_{unit}", f"b_{unit}", f"c_{unit}"): unit for unit in ("rad", "deg")}
_VECTORS = {(f"rx_{unit}", f"ry_{unit}", f"rz_{unit}"): unit for unit in ("rad", "deg")}
_QUATERNION = ("qx", "qy", "qz", "qw")
_EULER = [
    case("".join(order))
    for case in (str.upper, str.lower)
    for order in (*permutations("xyz"), *((a, b, a) for a, b in permutations("xyz", 2)))
]
"""Orders as SciPy names them: XYZ about axes that turn along, xyz about fixed ones."""


def read_robot_poses(path: Path, euler: str | None = None) -> tuple[dict[str, Pose], dict[str, dict[str, Pose]]]:
    """T_base_tool by view from a CSV: view; x_m,y_m,z_m or x_mm,…; and qx,qy,qz,qw, a rotation vector rx_rad,… or
    rx_deg,…, or Euler angles a_rad,b_rad,c_rad or a_deg,… in the order `euler`, as SciPy names it. With other readings
    of the rows, by the mistake that they stand for. Raises InputError naming file and line.
    """
    header = header_of(path)
    place = next((names for names in _PLACES if names[0] in header), ("x_m", "y_m", "z_m"))
    turn = next((names for names in (*_VECTORS, *_ANGLES) if names[0] in header), _QUATERNION)
    if turn in _ANGLES and euler not in _EULER:
        order = "none is given" if euler is None else f"it is {euler!r}"
        raise InputError(
            f"holds Euler angles and needs their order, {order}",
            where=path,
            remedy="--euler XYZ, ZYX (a KUKA's A B C), ZYZ (a Doosan's), …; in small letters about fixed axes (xyz: a "
            "FANUC's W P R)",
        )
    if turn not in _ANGLES and euler is not None:
        raise InputError(
            f"holds no Euler angles a_deg,b_deg,c_deg for --euler {euler}", where=path, remedy="leave it out"
        )
    places, turns = {}, {}
    for row in read_csv(path, ["view", *place, *turn]):
        name, where = row["view"], f"{path} line {row['line']}"
        if not name or name in places:
            what = f"view {name} stands twice" if name else "view is empty"
            raise InputError(what, where=where, remedy="give each view one row")
        values = {column: number(row, column, path) for column in (*place, *turn)}
        for column, value in values.items():
            if abs(value) > HandEyeSettings.largest:
                raise InputError(f"{column} is {value:g}", where=where, remedy="mend the row: no arm is posed so")
        places[name] = _PLACES[place] * np.array([values[column] for column in place])
        turns[name] = np.array([values[column] for column in turn])
        if turn == _QUATERNION and abs((length := math.hypot(*turns[name])) - 1.0) > HandEyeSettings.unit_quaternion:
            raise InputError(f"the quaternion's length is {length:.3g}, not 1", where=where, remedy="mend the row")
    rotations = np.array(list(turns.values()))

    def posed(turned: Rotation) -> dict[str, Pose]:
        return {name: Pose(own, places[name]) for name, own in zip(places, turned.as_matrix(), strict=True)}

    others = _other_readings(rotations, turn, euler)
    return posed(_rotations(rotations, turn, euler)), {words: posed(turned) for words, turned in others.items()}


def _rotations(values: np.ndarray, columns: tuple[str, ...], euler: str | None) -> Rotation:
    """Rotations from the numbers (V, 3 or 4) in these columns."""
    degrees = columns[0].endswith("_deg")
    if columns == _QUATERNION:
        return Rotation.from_quat(values)
    if columns in _VECTORS:
        return Rotation.from_rotvec(values, degrees=degrees)
    return Rotation.from_euler(str(euler), values, degrees=degrees)


def _other_readings(values: np.ndarray, columns: tuple[str, ...], euler: str | None) -> dict[str, Rotation]:
    """Other interpretations of the numbers, by the mistake in the file that each would mean."""
    if columns == _QUATERNION:
        return {"have quaternions with w first": _rotations(np.roll(values, -1, axis=1), columns, None)}
    unit, other = ("degrees", "rad") if columns[0].endswith("_rad") else ("rad", "degrees")
    swapped = tuple(f"{column[:-3]}{unit[:3]}" for column in columns)
    found = {f"are in {unit}, not in {other}": _rotations(values, swapped, euler)}
    angles = tuple(f"{each}_{columns[0][-3:]}" for each in "abc")
    orders = (order for order in _EULER if order != euler)
    return found | {f"have Euler angles in the order {order}": _rotations(values, angles, order) for order in orders}


def read_corners(path: Path, image_size: tuple[int, int], corner_count: int) -> list[BoardView]:
    """Views from a CSV of corners: view; id (or corner_id); u_px,v_px, (0, 0) the centre of the first pixel.

    Raises InputError for an id that the board has not, or twice in a view, and a corner outside the picture.
    """
    column = "corner_id" if "corner_id" in header_of(path) else "id"
    views: dict[str, dict[int, tuple[float, float]]] = {}
    for row in read_csv(path, ["view", column, "u_px", "v_px"]):
        name, where = row["view"], f"{path} line {row['line']}"
        corner, pixel = whole_number(row, column, path), (number(row, "u_px", path), number(row, "v_px", path))
        corners = views.setdefault(name, {})
        if not name:
            raise InputError("view is empty", where=where, remedy="name the picture")
        if corner >= corner_count:
            what = f"corner {corner}, but the board has {corner_count}"
            raise InputError(what, where=where, remedy="is this the board? ids count from 0")
        if corner in corners:
            raise InputError(f"corner {corner} of view {name} stands twice", where=where, remedy="take one away")
        if not all(-0.5 <= at <= size - 0.5 for at, size in zip(pixel, image_size, strict=True)):
            size = f"{image_size[0]}x{image_size[1]}"
            raise InputError(f"the corner lies outside the picture of {size} px", where=where, remedy="mend the row")
        corners[corner] = pixel
    return [
        BoardView(name, np.array(list(corners), int), np.array(list(corners.values())), image_size)
        for name, corners in views.items()
    ]
