"""How large a picture says it is, told from its file's first bytes without decoding it."""

from __future__ import annotations

import struct

_NO_FRAME = (0xC4, 0xC8, 0xCC)
"""JPEG markers between C0 and CF that carry no size."""
_TIFF_WIDTH, _TIFF_HEIGHT = 256, 257


def picture_size(data: bytes) -> tuple[int, int]:
    """(width, height) in px of a PNG, JPEG, BMP or TIFF; (0, 0) where it cannot be told."""
    try:
        if data.startswith(b"\x89PNG\r\n\x1a\n"):
            return struct.unpack_from(">II", data, 16)
        if data.startswith(b"\xff\xd8"):
            return _of_jpeg(data)
        if data.startswith(b"BM"):
            width, height = struct.unpack_from("<ii", data, 18)
            return abs(width), abs(height)  # a negative height: top row first
        if data.startswith((b"II*\0", b"MM\0*")):
            return _of_tiff(data, "<" if data.startswith(b"II") else ">")
    except (struct.error, IndexError):
        pass
    return 0, 0


def _of_jpeg(data: bytes) -> tuple[int, int]:
    """Of its first frame; a thumbnail lies inside a segment that is passed over."""
    position = 2
    while data[position : position + 1] == b"\xff":
        marker = data[position + 1]
        if 0xC0 <= marker <= 0xCF and marker not in _NO_FRAME:
            height, width = struct.unpack_from(">HH", data, position + 5)
            return width, height
        fill = marker == 0xFF
        position += 1 if fill else 2 + struct.unpack_from(">H", data, position + 2)[0]
    return 0, 0


def _of_tiff(data: bytes, order: str) -> tuple[int, int]:
    """Of the first directory."""
    (directory,) = struct.unpack_from(f"{order}I", data, 4)
    (entries,) = struct.unpack_from(f"{order}H", data, directory)
    found = {}
    for start in range(directory + 2, directory + 2 + 12 * entries, 12):
        tag, kind = struct.unpack_from(f"{order}HH", data, start)
        (found[tag],) = struct.unpack_from(f"{order}H" if kind == 3 else f"{order}I", data, start + 8)
    return found.get(_TIFF_WIDTH, 0), found.get(_TIFF_HEIGHT, 0)
