"""What a sheet says of its board: id, specification, how to print it."""

from __future__ import annotations

import hashlib

import numpy as np
import yaml
from reportlab.graphics.barcode import qrencoder

from .board import BoardSpec


def legacy_matters(spec: BoardSpec) -> bool:
    """Whether OpenCV's old and new pattern differ for this board: for an even number of rows only."""
    return spec.squares_y % 2 == 0


def board_id(spec: BoardSpec) -> str:
    """Eight hexadecimal digits that stand for what is printed: the same for the same print, always.

    Lengths count to the nanometre. The thickness is the mount's, not the print's, and does not count; nor does the
    legacy flag where both patterns are the same.
    """
    lengths = [round(1e9 * length) for length in (spec.square_m, spec.marker_m)]
    legacy = spec.legacy_pattern and legacy_matters(spec)
    text = f"charuco {spec.squares_x} {spec.squares_y} {lengths} {spec.dictionary} {legacy}"
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def spec_line(spec: BoardSpec) -> str:
    """The specification as one line of YAML: what the QR code holds, and a board.yaml as it stands."""
    return yaml.safe_dump(spec.to_dict(), default_flow_style=True, sort_keys=False, width=10**6).strip()


def spec_document(spec: BoardSpec, note: str = "") -> str:
    """board.yaml: the keys one a line, with a remark on top."""
    head = f"# ChArUco board {board_id(spec)}" + (f", {note}" if note else "")
    return f"{head}\n{yaml.safe_dump(spec.to_dict(), sort_keys=False)}"


def size_words(spec: BoardSpec) -> str:
    """Squares, markers and dictionary for a person."""
    pattern = ""
    if legacy_matters(spec):
        pattern = ", legacy pattern (OpenCV before 4.6)" if spec.legacy_pattern else ", pattern of OpenCV 4.6 and later"
    return (
        f"{spec.squares_x} × {spec.squares_y} squares of {1e3 * spec.square_m:.6g} mm, "
        f"markers of {1e3 * spec.marker_m:.6g} mm, {spec.dictionary}{pattern}"
    )


def qr_modules(text: str) -> np.ndarray:
    """(n, n) bool, true where the QR code is dark; its quiet zone of four modules is for the caller to leave."""
    code = qrencoder.QRCode(None, qrencoder.QRErrorCorrectLevel.M)
    code.addData(text)
    code.make()
    count = code.getModuleCount()
    return np.array([[bool(code.isDark(row, column)) for column in range(count)] for row in range(count)])
