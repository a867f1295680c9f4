"""COLMAP's cameras.txt (colmap/colmap, doc/format.rst; models in src/colmap/sensor/models.h).

- Pixels: (0.5, 0.5) is the centre of the first pixel: cx and cy stand there larger by 0.5 than here. The half is added
  and taken away in decimal, so that no bit is lost.
- One line a camera: CAMERA_ID MODEL WIDTH HEIGHT PARAMS. FULL_OPENCV has k1 k2 p1 p2 k3 k4 k5 k6 as OpenCV's eight,
  OPENCV the first four; OPENCV_FISHEYE k1 to k4 of OpenCV's fisheye. The models with one focal length, and the radial
  ones with one or two coefficients, are special cases of these.
- Poses stand picture by picture in images.txt, which is not written here.
"""

from __future__ import annotations

import math
from decimal import Decimal, InvalidOperation, localcontext
from pathlib import Path

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_text

from .values import Exchanged, Format, checked, intrinsics, matrix_of, numbers, one_of, size_of, stated, which_of

_MODELS = {
    "SIMPLE_PINHOLE": ("opencv", 1, 0),
    "PINHOLE": ("opencv", 2, 0),
    "SIMPLE_RADIAL": ("opencv", 1, 1),
    "RADIAL": ("opencv", 1, 2),
    "OPENCV": ("opencv", 2, 4),
    "FULL_OPENCV": ("opencv", 2, 8),
    "SIMPLE_RADIAL_FISHEYE": ("fisheye", 1, 1),
    "RADIAL_FISHEYE": ("fisheye", 1, 2),
    "OPENCV_FISHEYE": ("fisheye", 2, 4),
}
"""Name → our model, focal lengths, coefficients (filled up with zeros to four)."""
_HALF = Decimal("0.5")
_DIGITS = 400


def _read(path: Path, which: str | None) -> Exchanged:
    """`which` is the CAMERA_ID where it holds several."""
    lines = [(number, line.split()) for number, line in enumerate(read_text(path).splitlines(), 1)]
    rows = {cells[0]: (number, cells) for number, cells in lines if cells and not cells[0].startswith("#")}
    number, cells = rows[which_of(list(rows), which, path)]
    place = Path(f"{path} line {number}")
    model = one_of(cells[1] if len(cells) > 1 else "", _MODELS, "the model", place)
    ours, focal, count = _MODELS[model]
    wanted = 4 + focal + 2 + count
    if len(cells) != wanted:
        raise InputError(f"{len(cells)} cells, {model} has {wanted}", where=place, remedy="write the line again")
    size = size_of([("the picture's side", _plain(cell, place)) for cell in cells[2:4]], place)
    f = [_plain(cell, place) for cell in cells[4 : 4 + focal]]
    centre = [float(_decimal(cell, place, -_HALF)) for cell in cells[4 + focal : 6 + focal]]
    coefficients = [_plain(cell, place) for cell in cells[6 + focal :]]
    filled = coefficients + [0.0] * (4 - count) if 0 < count < 4 else coefficients
    values = numbers([f[0], f[-1], *centre, *filled], "PARAMS", place, (4 + len(filled),))
    return Exchanged(checked(ours, size, matrix_of(*values[:4]), values[4:], place))


def _write(given: Exchanged) -> str:
    camera = given.camera
    written = {(model, count): name for name, (model, focal, count) in _MODELS.items() if focal == 2}
    name, coefficients = stated(camera, written, "COLMAP's FULL_OPENCV")
    fx, fy, cx, cy = intrinsics(camera)
    centre = [str(_decimal(repr(value), None, _HALF)) for value in (cx, cy)]
    cells = [repr(fx), repr(fy), *centre, *map(repr, coefficients)]
    return (
        "# Camera list with one line of data per camera:\n"
        "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
        "# Number of cameras: 1\n"
        f"1 {name} {camera.image_size[0]} {camera.image_size[1]} {' '.join(cells)}\n"
    )


def _fits(text: str) -> bool:
    lines = (line.split() for line in text.splitlines() if not line.lstrip().startswith("#"))
    first = next((cells for cells in lines if cells), [])
    return len(first) > 4 and first[1] in _MODELS


def _plain(text: str, place: Path) -> float:
    value = float(_decimal(text, place, Decimal(0)))
    if not math.isfinite(value):
        raise InputError(f"{text:.60} is too large", where=place, remedy="write the line again")
    return value


def _decimal(text: str, place: Path | None, shift: Decimal) -> Decimal:
    """A number as it is written, plus a shift, exactly."""
    try:
        value = Decimal(text)
        if not value.is_finite() or abs(value.adjusted()) > 320 or len(text) > _DIGITS:
            raise InvalidOperation
    except InvalidOperation:
        raise InputError(f"{text!r:.60} is no number", where=place, remedy="write the line again") from None
    with localcontext() as context:
        context.prec = _DIGITS
        return value + shift


FORMAT = Format("colmap", "cameras.txt of COLMAP", _read, _write, _fits, several=True)
