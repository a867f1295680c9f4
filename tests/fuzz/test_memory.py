"""Files that unpack, repeat or announce much: read or refused within 50 times their size and 200 MB."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable
from contextlib import suppress
from io import BytesIO
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.parquet as parquet
import pytest
from PIL import Image

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import most_memory
from vbaa_calib.core.images import read_gray, read_picture

from ..hostile.damage import png
from .fuzz import READERS

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the peak of memory is told by Linux alone")
READ = {reader.name: reader for reader in READERS}
MOST = 150_000
"""Bytes of a dense text: what grows more than allowed shows at ten times that, too."""
SIDE = 3600


def taken(read: Callable[[], object]) -> int:
    """Bytes by which the memory of this process grows at most; what is read is dropped."""

    def told(name: str) -> int:
        lines = Path("/proc/self/status").read_text().splitlines()
        return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(name))

    gc.collect()
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    before = told("VmRSS")
    with suppress(InputError):
        read()
    return told("VmHWM") - before


def picture(kind: str, mode: str, **options: object) -> bytes:
    """A black one of 13 million pixels."""
    made = BytesIO()
    Image.new(mode, (SIDE, SIDE)).save(made, kind, **options)
    return made.getvalue()


def deep(colour: int) -> bytes:
    channels = {0: 1, 2: 3, 6: 4}[colour]
    return png(SIDE, SIDE, bytes(SIDE * (2 * channels * SIDE + 1)), bits=16, colour=colour)


PICTURES: dict[str, Callable[[], bytes]] = {
    "grey of 16 bits": lambda: deep(0),
    "colour of 16 bits": lambda: deep(2),
    "colour of 16 bits with alpha": lambda: deep(6),
    "one that moves": lambda: picture(
        "PNG", "RGBA", save_all=True, append_images=[Image.new("RGBA", (SIDE, SIDE), (9, 9, 9, 9))]
    ),
    "a progressive JPEG": lambda: picture("JPEG", "RGB", subsampling=0, progressive=True),
    "a TIFF of one strip": lambda: picture("TIFF", "RGB", compression="tiff_adobe_deflate", strip_size=1 << 30),
    "a TIFF of 16 bits": lambda: picture("TIFF", "I;16", compression="tiff_adobe_deflate"),
    "a WebP": lambda: picture("WEBP", "RGBA", lossless=True),
    "a BMP": lambda: picture("BMP", "RGB"),
    "JPEG 2000": lambda: picture("JPEG2000", "RGB"),
    "a GIF": lambda: picture("GIF", "P"),
}


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_takes_no_more_than_allowed(name: str) -> None:
    data = PICTURES[name]()
    for read in (read_gray, read_picture):
        assert taken(lambda read=read: read(Path("picture"), data)) <= most_memory(len(data))  # type: ignore[misc]


def rows_of(head: bytes, row: Callable[[int], str]) -> bytes:
    count = MOST // len(row(1000))
    return head + b"".join(f"{row(index)}\n".encode() for index in range(count))


DENSE: dict[str, Callable[[bytes], bytes]] = {
    **dict.fromkeys(("rig", "camera", "wizard", "truth", "batch"), lambda _: b'{"a":[' + b'{"":0},' * 20_000 + b"0]}"),
    **dict.fromkeys(("session", "board", "scene", "answers", "ros"), lambda _: b"a: [" + b"[]," * 49_000 + b"0]\n"),
    "recording": lambda head: rows_of(head, lambda k: f"{k},{k},frame_0000.png,0,0,0"),
    "poses": lambda head: rows_of(head, lambda k: f"{k},0,0,0,0,0,0,1"),
    "corners": lambda head: rows_of(head, lambda k: f"{k // 88},{k % 88},1,1"),
    "readings": lambda head: rows_of(head, lambda k: f"{k},,,"),
    "batch_list": lambda head: rows_of(head, lambda k: f"{k},,"),
    "fleet": lambda head: rows_of(head, lambda k: f"session,2026-01-01T00:00:00.{k:06d}"),
    "lines": lambda _: b'{"a":[' + b"[]," * 50_000 + b"0]}\n",
}
"""What takes most memory for its size, after a table's first line."""
QUICK = ("rig", "session", "ros", "recording", "corners", "lines")
"""One of each way to read."""


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name not in QUICK)) for name in DENSE])
def test_a_dense_text_takes_no_more_than_allowed(name: str, folder: Path) -> None:
    """Of the multiple alone three times as much, and with it no more than a quarter of the constant."""
    path = folder / READ[name].file
    good = path.read_bytes()
    data = DENSE[name](good.partition(b"\n")[0] + b"\n")
    path.unlink()
    path.write_bytes(data)
    try:
        assert taken(lambda: READ[name].read(path)) <= 3 * (most_memory(len(data)) - most_memory(0)) + 5e7
    finally:
        path.write_bytes(good)


def contacts_of(good: Path, rows: int, reason: str) -> bytes:
    """Contacts packed to nothing: every row the same, but for its number."""
    table = parquet.read_table(good, partitioning=None)
    some = np.zeros(rows, int)
    columns = {name: table.column(name).take(some) for name in table.column_names}
    columns["frame"] = pyarrow.array(np.arange(rows))
    columns["reason"] = pyarrow.array([reason] + [""] * (rows - 1))
    made = BytesIO()
    kept = [name for name in columns if name != "frame"]
    options = {"use_dictionary": kept, "column_encoding": {"frame": "DELTA_BINARY_PACKED"}, "compression": "zstd"}
    parquet.write_table(pyarrow.table(columns), made, **options)
    return made.getvalue()


@pytest.mark.parametrize(("rows", "reason"), [(300_000, ""), (5, "x" * 250_000_000)], ids=["rows", "a text"])
def test_contacts_that_unpack_to_much_are_refused(rows: int, reason: str, folder: Path) -> None:
    data = contacts_of(folder / "contacts.parquet", rows, reason)
    path = folder / "forged.parquet"
    path.write_bytes(data)
    assert taken(lambda: READ["parquet"].read(path)) < most_memory(len(data))
    with pytest.raises(InputError, match="unpacks to"):
        READ["parquet"].read(path)
    path.unlink()
