"""A jig for the board and a clamp for the antenna, as solids to print in 3-D.

    python targets/jig.py -o printed/ --squares 9x7 --square-mm 12 --thickness-mm 3 --wire-mm 0.8

writes jig.stl, clamp.stl, cap.stl, and jig.yaml, the section `jig` of session.yaml with the board's pose.

Millimetres in the antenna frame: the clamp's front face is at x = 0, the antenna runs along x at y = z = 0, z points to
the camera. Each part is boxes less boxes: its faces are those between full and empty cells of the grid that all boxes
span, so that the mesh is closed and every size is as asked. Round holes are square pilots, to be drilled.
"""

from __future__ import annotations

import argparse
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

Box = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
"""First and last x, y and z."""


def _mesh(added: Sequence[Box], removed: Sequence[Box] = ()) -> np.ndarray:
    """(T, 3, 3) triangles of boxes minus other boxes, mm, counter-clockwise from outside."""
    axes = [np.unique([end for box in (*added, *removed) for end in box[axis]]) for axis in range(3)]
    middles = [0.5 * (axis[1:] + axis[:-1]) for axis in axes]

    def inside(box: Box) -> np.ndarray:
        x, y, z = ((low < middle) & (middle < high) for middle, (low, high) in zip(middles, box, strict=True))
        return x[:, None, None] & y[None, :, None] & z[None, None, :]

    full = np.any([inside(box) for box in added], axis=0)
    for box in removed:
        full &= ~inside(box)
    cells, faces = np.pad(full, 1), []
    for axis in range(3):
        others = [(axis + 1) % 3, (axis + 2) % 3]
        change = np.diff(cells.astype(int), axis=axis)
        for place in np.argwhere(change):
            # the cell's corners in the unpadded grid, across the axis
            at = place - [0 if each == axis else 1 for each in range(3)]
            corners = []
            for first, second in ((0, 0), (1, 0), (1, 1), (0, 1)):
                corner = at.copy()
                corner[others[0]] += first
                corner[others[1]] += second
                corners.append([axes[each][corner[each]] for each in range(3)])
            corners = corners if change[tuple(place)] < 0 else corners[::-1]
            faces += [[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]]
    return np.array(faces)


def _stl(triangles: np.ndarray) -> bytes:
    """A binary STL of triangles (T, 3, 3), mm."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    rows = np.concatenate([normals[:, None], triangles], axis=1).reshape(-1, 12).astype("<f4")
    facets = b"".join(row.tobytes() + b"\0\0" for row in rows)
    return b"solid of vbaa-calib, mm".ljust(80) + struct.pack("<I", len(rows)) + facets


def _clamp_mm() -> tuple[float, float, float]:
    """Length, width and height of the clamp's block."""
    return 16.0, 24.0, 14.0


def _clamp(wire_mm: float, screws_mm: float = 8.0, pilot_mm: float = 2.5) -> dict[str, np.ndarray]:
    """Meshes of the clamp: a block with a groove half as deep as the antenna is thick, and the cap that presses on it.

    screws_mm : from the antenna to either of two pilot holes, pilot_mm wide.
    """
    length, width, height = _clamp_mm()
    sides = (-length, 0.0), (-0.5 * width, 0.5 * width)
    groove = (-length, 0.0), (-0.5 * wire_mm - 0.05, 0.5 * wire_mm + 0.05)
    half = 0.5 * pilot_mm
    holes = [
        ((-0.5 * length - half, -0.5 * length + half), (y - half, y + half), (-height, 8.0))
        for y in (-screws_mm, screws_mm)
    ]
    block = _mesh([(*sides, (-height, 0.0))], [(*groove, (-0.5 * wire_mm, 0.0)), *holes])
    return {"clamp": block, "cap": _mesh([(*sides, (0.0, 6.0))], [(*groove, (0.0, 0.35 * wire_mm)), *holes])}


def _tray(plate_mm: tuple[float, float], back_mm: float, gap_mm: float, wall_mm: float = 3.0) -> np.ndarray:
    """A tray with a floor that supports the plate's back at a height, a gap in front of the clamp, two walls that
    stop it, and a fork around the clamp with 0.15 mm of play."""
    length, width, height = _clamp_mm()
    across, half = 0.5 * width + 0.15, 0.5 * plate_mm[1]
    floor = (back_mm - wall_mm, back_mm)
    end, outer = gap_mm + plate_mm[0], max(half, across) + wall_mm
    boxes: list[Box] = [
        ((0.0, end), (-outer, outer), floor),
        ((gap_mm - wall_mm, gap_mm), (-outer, outer), (floor[0], back_mm + wall_mm)),
        ((0.0, end), (half, outer), (floor[0], back_mm + wall_mm)),
    ]
    boxes += [((-length, 0.0), (side - wall_mm, side), floor) for side in (-across, across + wall_mm)]
    assert floor[0] > -height
    return _mesh(boxes)


def _write_jig(
    folder: Path, outline_mm: tuple[float, float], *, margin_mm: float, thickness_mm: float, wire_mm: float
) -> str:
    """Write jig.stl, clamp.stl, cap.stl and jig.yaml into a folder; return the text of the last.

    outline_mm : the board's squares, along x and y. margin_mm : of the plate around them. thickness_mm : of the plate.
    Raises ValueError for sizes that cannot be printed.
    """
    if not (0.2 <= wire_mm <= 3.0 and min(outline_mm) >= 20.0 and margin_mm >= 0.0 and 0.0 <= thickness_mm <= 6.0):
        raise ValueError("a wire of 0.2 to 3 mm, a board of 20 mm or more on a plate of up to 6 mm are needed")
    # the printed face stays below the antenna
    back_mm, gap_mm = -(thickness_mm + wire_mm + 1.0), 8.0
    plate = (outline_mm[0] + 2.0 * margin_mm, outline_mm[1] + 2.0 * margin_mm)
    folder.mkdir(parents=True, exist_ok=True)
    for name, triangles in ({"jig": _tray(plate, back_mm, gap_mm)} | _clamp(wire_mm)).items():
        (folder / f"{name}.stl").write_bytes(_stl(triangles))
    corner = (gap_mm + margin_mm, 0.5 * outline_mm[1], back_mm)
    place = ", ".join(f"{1e-3 * value:.6g}" for value in corner)
    text = (
        "jig:   # of session.yaml; printed sizes are good to about 0.2 mm: measure x, y, z with a caliper\n"
        f"  T_antenna_board: {{translation_m: [{place}], rotation_xyzw: [1.0, 0.0, 0.0, 0.0]}}\n"
        "  translation_std_m: 0.0002\n"
        "  rotation_std_rad: 0.002\n"
    )
    (folder / "jig.yaml").write_text(text, encoding="utf-8")
    return text


def _run() -> None:
    parser = argparse.ArgumentParser(description="A jig for the board and a clamp for the antenna, to print in 3-D.")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FOLDER", help="where the files go")
    parser.add_argument("--squares", default="9x7", metavar="CxR", help="of the board (default: 9x7)")
    parser.add_argument("--square-mm", type=float, default=12.0, metavar="MM", help="side of a square (default: 12)")
    parser.add_argument("--margin-mm", type=float, default=5.0, metavar="MM", help="plate around them (default: 5)")
    parser.add_argument("--thickness-mm", type=float, default=3.0, metavar="MM", help="of the plate (default: 3)")
    parser.add_argument(
        "--wire-mm", type=float, default=0.8, metavar="MM", help="the antenna's diameter (default: 0.8)"
    )
    args = parser.parse_args()
    try:
        columns, rows = (int(number) for number in args.squares.split("x"))
        outline = (columns * args.square_mm, rows * args.square_mm)
        sizes = {"margin_mm": args.margin_mm, "thickness_mm": args.thickness_mm, "wire_mm": args.wire_mm}
        print(_write_jig(args.output, outline, **sizes), end="")
    except ValueError as error:
        parser.error(str(error))


if __name__ == "__main__":
    _run()
