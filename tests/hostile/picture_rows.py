"""Pictures that no decoder should be trusted with."""

from __future__ import annotations

import struct

import numpy as np

from . import damage as d
from .case import Case, Row, cases
from .every_file import CALIBRATE, ESTIMATE

NOT_WHOLE, NONE = "is truncated or damaged", "is not a picture"


def jpeg_of(width: int, height: int) -> d.Damage:
    """A JPEG whose frame announces another size."""

    def change(data: bytes) -> bytes:
        at = data.index(b"\xff\xc0") + 5
        return data[:at] + struct.pack(">HH", height, width) + data[at + 4 :]

    return d.several(d.encoded(".jpg"), d.changed(change))


def tiff(*tags: tuple[int, int, int]) -> bytes:
    """A TIFF of one directory: (tag, kind, value) each."""
    entries = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in tags)
    return b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + struct.pack("<I", 0) + bytes(64)


GREY_TIFF = ((258, 3, 8), (259, 3, 1), (262, 3, 1), (273, 4, 90), (277, 3, 1), (278, 4, 1), (279, 4, 4))

ROWS: tuple[Row, ...] = (
    ("a bomb, PNG", d.content(d.png(20_000, 20_000, bytes(1000))), "is 20000x20000 px", "million"),
    ("a bomb of 2^31 columns", d.content(d.png(2**31 - 1, 2, bytes(10))), "px, more than"),
    ("a bomb, JPEG", jpeg_of(65_500, 65_500), "is 65500x65500 px"),
    ("a bomb, TIFF", d.content(tiff((256, 4, 50_000), (257, 4, 50_000), *GREY_TIFF)), "is 50000x50000 px"),
    ("fewer rows than announced", d.content(d.png(480, 360, bytes(481 * 100))), ""),
    ("a palette without colours", d.content(d.png(480, 360, bytes(481 * 360), colour=3)), NONE),
    ("a JPEG cut short", d.several(d.encoded(".jpg"), d.cut(0.6)), NOT_WHOLE),
    ("a TIFF of floats", d.encoded(".tiff", np.float32), "holds pixels of type float32"),
)
NOTHING_ON_IT: tuple[Row, ...] = (
    ("grey", d.grey, "no antenna found"),
    ("noise", d.specks, "no antenna found"),
    ("a board", d.copy("../plane/jig_000.png"), "no antenna found"),
)
NO_BOARD: tuple[Row, ...] = (("grey", d.grey, "no board is found"), ("noise", d.specks, "no board is found"))

CASES: list[Case] = [
    *cases("free.png", "look free.png --rig rig.json", ROWS),
    *cases("session/recording/frame_0003.png", ESTIMATE, ROWS[1::6]),
    *cases("session/loads/loads_002.png", CALIBRATE, NOTHING_ON_IT[:1]),
    *cases("session/noload/noload_001.png", CALIBRATE, NOTHING_ON_IT[2:]),
    *cases("session/intrinsics", "intrinsics session/intrinsics --board board.yaml -o o.json", NO_BOARD),
    *cases("session/plane/jig_000.png", CALIBRATE, NO_BOARD[:1]),
]
