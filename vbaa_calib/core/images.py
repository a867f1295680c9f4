"""Reading pictures: a damaged one is refused by name, never half decoded."""

from __future__ import annotations

import contextlib
import struct
import threading
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Literal

import numpy as np

from .errors import InputError
from .files import most_memory, read_bytes

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
OTHER_KINDS = (
    ".heic",
    ".heif",
    ".avif",
    ".webp",
    ".dng",
    ".cr2",
    ".cr3",
    ".nef",
    ".arw",
    ".raf",
    ".rw2",
    ".orf",
    ".raw",
)
CONVERT = f"save them as {', '.join(SUFFIXES)}, in full size; phones can be set to JPEG (Most Compatible)"
_MOST_PIXELS = 200_000_000
_PNG, _JPEG, _BMP = b"\x89PNG\r\n\x1a\n", b"\xff\xd8", b"BM"
_AGAIN = "copy or export the picture again, or remove it"
_log_level = threading.Lock()


def list_images(folder: Path) -> list[Path]:
    """Pictures in a folder (png, jpg, jpeg, tif, tiff, bmp), sorted by name.

    Raises InputError when the folder is missing, is not a folder, or holds no picture.
    """
    folder = Path(folder)
    if not folder.exists():
        raise InputError("no such folder", where=folder, remedy="check the path")
    if not folder.is_dir():
        raise InputError("is not a folder", where=folder, remedy="name the folder that holds the pictures")
    try:
        entries = sorted(folder.iterdir())
    except OSError as error:
        raise InputError(f"cannot be read ({error})", where=folder, remedy="check its permissions") from None
    images = [path for path in entries if path.suffix.lower() in SUFFIXES and not path.name.startswith(".")]
    if others := _other_kinds([path.name for path in entries]):
        raise InputError(others, where=folder, remedy=CONVERT)
    if not images:
        raise InputError("holds no pictures", where=folder, remedy=f"put {', '.join(SUFFIXES)} files into it")
    return images


def _other_kinds(names: Iterable[str]) -> str:
    """How many pictures are of kinds that are not read, of phones and raw ones, in words; "" without any.
    One next to a picture of the same name that is read does not count."""
    paths = [Path(name) for name in names if not name.startswith(".")]
    read = {path.stem for path in paths if path.suffix.lower() in SUFFIXES}
    others = Counter(
        path.suffix.lower() for path in paths if path.suffix.lower() in OTHER_KINDS and path.stem not in read
    )
    return " and ".join(f"{count} pictures are {suffix}" for suffix, count in others.items())


def read_gray(path: Path, data: bytes | None = None) -> np.ndarray:
    """One picture as (H, W) uint8, in the sensor's own orientation (an EXIF rotation is not applied).

    Colour is turned to gray. A 16-bit picture is scaled by the smallest usual sensor depth (10, 12, 14, 16 bit) that
    holds its brightest pixel. data : the file's bytes, where they were read already.

    Raises InputError naming the file when it is missing, empty, truncated or damaged.
    """
    pixels = _pixels(data, Path(path), "grey")
    return pixels if pixels.dtype == np.uint8 else _scaled(pixels, np.rint, np.uint8)


def read_picture(path: Path, data: bytes | None = None, upright: bool = False) -> np.ndarray:
    """One picture at full depth and in colour: (H, W) grey or (H, W, 3) blue, green, red, in the sensor's
    orientation, or upright by its EXIF rotation, as viewers turn it.

    uint8, or float32 from 0 to 255 where there are more bits, scaled as `read_gray` does. Transparency is left out.
    data : the file's bytes, where they were read already. Raises InputError as `read_gray` does.
    """
    return as_levels(_pixels(data, Path(path), "upright" if upright else "kept"))


def as_levels(pixels: np.ndarray) -> np.ndarray:
    """8-bit pixels unchanged; 16-bit ones as float32 from 0 to 255, scaled as `read_gray` does.

    Grey parts of a demosaiced picture get the sensor's own samples back: interpolated ones move lines along its rows.
    """
    pixels = _as_sampled(pixels)
    return pixels if pixels.dtype == np.uint8 else _scaled(pixels, np.asarray, np.float32)


def _as_sampled(pixels: np.ndarray, cell_px: int = 8, chroma: float = 0.05) -> np.ndarray:
    """A demosaiced picture (H, W, 3) with the sensor's own sample in all channels of its grey pixels, (H, W) if all are
    grey; a picture that was not interpolated linearly from a colour filter's samples stays as it is.

    cell_px : side of the cells that are grey or coloured. chroma : a cell is coloured where its mean channels differ
        by more than this part of the brightest pixel; less colour moves a line by less than 0.02 px.
    """
    if pixels.ndim < 3 or min(pixels.shape[:2]) < 2 * cell_px:
        return pixels
    # rows from all over it, with their neighbours: interpolated green is the mean of four, red and blue at each other's
    # samples that of the four at the corners, which noise alone is not
    first = 2 * np.linspace(0, (len(pixels) - 4) // 2, 24).astype(int)
    some = pixels[first[:, None] + np.arange(4)].astype(np.int32)
    own, up, down = some[:, 1:-1], some[:, :-2], some[:, 2:]
    means = (up + down)[:, :, 1:-1] + own[:, :, :-2] + own[:, :, 2:], (up + down)[:, :, :-2] + (up + down)[:, :, 2:]
    blue, green, red = (
        # by the parities of row and column
        np.array([[exact[:, 1 - i :: 2, 1 - j :: 2].mean() for j in (0, 1)] for i in (0, 1)])
        for exact in (np.abs(4 * own[:, :, 1:-1] - means[c != 1])[..., c] <= 2 for c in range(3))
    )
    at_red, at_blue = np.argwhere((green > 0.9) & (blue > 0.9)), np.argwhere((green > 0.9) & (red > 0.9))
    if len(at_red) != 1 or len(at_blue) != 1 or (at_red == at_blue).any() or np.sort(green, axis=None)[1] > 0.8:
        return pixels
    sampled = pixels[..., 1].copy()
    for channel, (row, column) in ((2, at_red[0]), (0, at_blue[0])):
        sampled[row::2, column::2] = pixels[row::2, column::2, channel]
    height, width = (side // cell_px for side in pixels.shape[:2])
    import cv2  # slow to load

    cells = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA)
    coloured = (np.ptp(cells, axis=2) > chroma * float(pixels.max())).astype(np.uint8)
    if not coloured.any():
        return sampled
    kept = cv2.resize(coloured, pixels.shape[1::-1], interpolation=cv2.INTER_NEAREST)
    return np.where(kept[..., None] > 0, pixels, sampled[..., None])


def _scaled(pixels: np.ndarray, rounded: Callable[[np.ndarray], np.ndarray], kind: type[np.generic]) -> np.ndarray:
    """Pixels scaled to 0 to 255, row by row: in one piece that would take four times the memory."""
    factor, levels = _to_255(pixels), np.empty(pixels.shape, kind)
    for row, level in zip(pixels, levels, strict=True):
        level[...] = rounded(row * factor)
    return levels


def picture_size(path: Path) -> tuple[int, int]:
    """(width, height) px of a complete picture, in the sensor's own orientation.

    Raises InputError as `read_gray` does. PNG and JPEG files say it themselves: they are not decoded.
    """
    data = read_bytes(path, "picture")
    width, height = _announced(data, path)
    if data.startswith((_PNG, _JPEG)):
        return width, height
    height, width = _pixels(data, path, "grey").shape
    return width, height


def _announced(data: bytes, path: Path) -> tuple[int, int]:
    """(width, height) by the file's header. Raises InputError where the file is empty, truncated, of another format,
    or would take more memory than the limit."""
    if not data:
        raise InputError("is an empty file", where=path, remedy=_AGAIN)
    # decoders fill what is missing with gray and only print a warning
    size_of_bmp = struct.unpack_from("<I", data, 2)[0] if data.startswith(_BMP) and len(data) >= 6 else 0
    torn_png = data.startswith(_PNG) and not _png_is_whole(data)
    torn_jpeg = data.startswith(_JPEG) and not _jpeg_is_whole(data)
    if torn_png or torn_jpeg or len(data) < size_of_bmp:
        raise InputError("is truncated or damaged", where=path, remedy=_AGAIN)
    width = height = at_once = -1
    with contextlib.suppress(LookupError, StopIteration, struct.error):  # what is damaged has no size
        width, height = _size(data)
        at_once = width * height
    # what is decoded is copied once; of 16 bits there are floats beside it
    if data.startswith(_PNG) and width > 0:
        before = data[: data.find(b"IDAT")]
        samples = (4 if data[25] != 0 or b"tRNS" in before else 1) + 4 * (b"acTL" in before)  # one that moves has two
        bytes_per_pixel = samples * (6 if data[24] == 16 else 2)
    elif data.startswith(_JPEG) and width > 0:
        bytes_per_pixel = 3 * data[_start_of_frame(data) + 9]  # a progressive one has its coefficients beside it
    elif data.startswith((b"II*\0", b"MM\0*")):
        width, height, at_once, bytes_per_pixel = _of_tiff(data)
    else:
        bytes_per_pixel = 12
    if min(width, height) <= 0 or bytes_per_pixel <= 0:
        raise InputError("is not a picture that can be read", where=path, remedy=_AGAIN)
    if at_once > _MOST_PIXELS or at_once * bytes_per_pixel > most_memory(len(data)):
        # a small file may announce pixels that fill the memory
        most = min(_MOST_PIXELS, most_memory(len(data)) // bytes_per_pixel)
        what = f"is {width}x{height} px, more than the {most / 1e6:.0f} million that a file of its size may have"
        raise InputError(what, where=path, remedy="export a smaller picture, or remove it")
    return width, height


def _size(data: bytes) -> tuple[int, int]:
    """(width, height) by the header of a PNG, JPEG, BMP or WebP file; −1 for another format, known only after
    decoding. Raises LookupError, StopIteration or struct.error for a damaged one."""
    if data.startswith(_PNG):
        width, height = struct.unpack_from(">II", data, 16)
    elif data.startswith(_JPEG):
        height, width, _ = struct.unpack_from(">HHB", data, _start_of_frame(data) + 5)
    elif data.startswith(_BMP):
        width, height = struct.unpack_from("<HH" if data[14:15] == b"\x0c" else "<ii", data, 18)
    elif data[:4] + data[8:15] == b"RIFFWEBPVP8":
        at, shift, size, more = {b" ": (26, 16, 14, 0), b"L": (21, 14, 14, 1), b"X": (24, 24, 24, 1)}[data[15:16]]
        (bits,) = struct.unpack_from("<Q", data, at)
        width, height = ((each & ((1 << size) - 1)) + more for each in (bits, bits >> shift))
    else:
        return -1, -1
    return width, abs(height)  # of a BMP −height: top row first


def _start_of_frame(data: bytes) -> int:
    """Position of the JPEG segment that contains the size."""
    return next(at for at, marker in _segments(data) if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC))


def _of_tiff(data: bytes) -> tuple[int, int, int, int]:
    """(width, height) of a TIFF file's first picture, −1 unknown; the number of pixels decoded at once, and their
    bytes."""
    order, tags = "<" if data.startswith(b"I") else ">", dict[int, int]()
    try:
        (at,) = struct.unpack_from(f"{order}I", data, 4)
        (count,) = struct.unpack_from(f"{order}H", data, at)
        for entry in range(at + 2, at + 2 + 12 * count, 12):
            tag, kind, number, place = struct.unpack_from(f"{order}HHII", data, entry)
            short = kind == 3
            value = struct.unpack_from(f"{order}{'H' if short else 'I'}", data, entry + 8 if number < 3 else place)[0]
            tags.setdefault(tag, value)
    except struct.error:
        pass  # what is not there is not read
    # by TIFF's tags: 256 width, 257 height, 258 bits, 277 samples per pixel, 322 and 323 sides of a tile
    width, height, bits = tags.get(256, -1), tags.get(257, -1), tags.get(258, 1)
    tile = tags.get(322, 0) * tags.get(323, 0)
    # of 8 bits a whole strip, which may be all of it, is decoded in four colours first
    bytes_per_pixel = 12 if bits <= 8 else tags.get(277, 1) * (6 if bits <= 16 else 3 * bits // 8)
    return width, height, max(width * height, tile), bytes_per_pixel


def _pixels(data: bytes | None, path: Path, colours: Literal["grey", "kept", "upright"]) -> np.ndarray:
    """The pixels of a picture in grey, or in its own colours, as they are or upright."""
    import cv2  # slow to load

    data = read_bytes(path, "picture") if data is None else data
    _announced(data, path)
    flags = {
        "grey": cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION,
        "kept": cv2.IMREAD_UNCHANGED,  # is all bits set, and keeps depth and orientation by itself
        "upright": cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH,
    }
    pixels = None
    # the level is global to the process, so two threads must not restore each other's
    with _log_level, contextlib.suppress(cv2.error):
        level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        try:
            pixels = cv2.imdecode(np.frombuffer(data, np.uint8), flags[colours])
        finally:
            cv2.utils.logging.setLogLevel(level)
    if pixels is not None and pixels.ndim == 3:
        pixels = pixels[..., :3] if pixels.shape[2] > 2 else pixels[..., 0]
    if pixels is None or pixels.ndim not in (2, 3) or pixels.size == 0:
        raise InputError("is not a picture that can be read", where=path, remedy=_AGAIN)
    if pixels.dtype not in (np.uint8, np.uint16):
        raise InputError(
            f"holds pixels of type {pixels.dtype}", where=path, remedy="save it with 8 or 16 bits per channel"
        )
    return pixels


def _to_255(pixels: np.ndarray) -> float:
    """Factor that scales the sensor's own depth to 8 bits."""
    brightest = int(pixels.max())
    bits = next(bits for bits in (10, 12, 14, 16) if brightest < 1 << bits)
    return 255.0 / ((1 << bits) - 1)


def _png_is_whole(data: bytes) -> bool:
    """Whether all chunks up to IEND are there with correct CRCs."""
    position = 8
    while position + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, position)
        end = position + 12 + length
        if end > len(data):
            return False
        kind_and_body = memoryview(data)[position + 4 : end - 4]
        if zlib.crc32(kind_and_body) != struct.unpack_from(">I", data, end - 4)[0]:
            return False
        if data[position + 4 : position + 8] == b"IEND":
            return True
        position = end
    return False


def _jpeg_is_whole(data: bytes) -> bool:
    """Whether there is an end-of-image marker; an embedded thumbnail's own end does not count."""
    return any(marker == 0xD9 for _, marker in _segments(data))


def _segments(data: bytes) -> Iterator[tuple[int, int]]:
    """(position, marker) of a JPEG file's segments, in order."""
    position = 2
    while True:
        position = data.find(b"\xff", position)
        if position < 0 or position + 1 >= len(data):
            return
        marker = data[position + 1]
        yield position, marker
        if marker == 0xFF:  # fill byte
            position += 1
        elif marker in (0x00, 0x01) or 0xD0 <= marker <= 0xD9:  # stuffed byte, TEM, restarts, ends: no body
            position += 2
        elif position + 4 > len(data):
            return
        else:
            position += 2 + struct.unpack_from(">H", data, position + 2)[0]
