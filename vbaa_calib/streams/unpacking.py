"""What a bag unpacks to, bounded: a few bytes can say gigabytes, and rosbags unpacks them as a whole."""

from __future__ import annotations

import bz2
from collections.abc import Callable
from io import BytesIO
from itertools import accumulate
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from vbaa_calib.convert.child import read_bag_head, read_in_child, take_all_schemas
from vbaa_calib.core.errors import InputError, clipped
from vbaa_calib.core.files import most_memory

_PIECE_BYTES, _PIECE_FACTOR = 50_000_000, 10
"""Of what is unpacked at once: some bytes, and a multiple of the packed size. A picture is copied four times on its
way: together this stays within a child's limits."""
_REMEDY = "record it with chunks of some megabytes, as rosbag2 does"


def check_bag(path: Path, metadata: dict[str, Any]) -> None:
    """Opens a bag in a process of its own, with limits of time and memory. metadata : of a bag that is a folder.

    Raises InputError for one that cannot be opened within them.
    """
    about = metadata.get("rosbag2_bagfile_information")
    try:
        if isinstance(about, dict) and str(about.get("compression_mode")).lower() == "file":
            _check_files(path, about["relative_file_paths"])
        read_in_child(read_bag_head, path)
    except InputError:
        raise
    except Exception as error:  # of a damaged file the readers let anything through
        remedy = "record or copy it again, or mend it (mcap recover)"
        what = f"cannot be read as a bag ({clipped(str(error).partition(chr(10))[0])})"
        raise InputError(what, where=path, remedy=remedy) from None


def _check_files(path: Path, names: Any) -> None:
    """Raises InputError for a bag of packed files that unpack to more than a child may have: they go to the disk."""
    zstd, unpacked, packed = _rosbags().mcap.zstd, 0, 0
    for file in {path / Path(str(name)).name for name in names}:
        if file.is_file():
            packed += file.stat().st_size
            with file.open("rb") as stream, zstd.open(stream, "rb") as opened:
                while piece := opened.read(1 << 20):
                    unpacked += len(piece)
                    if unpacked > most_memory(packed):
                        what = f"unpacks to more than {unpacked / 1e6:.0f} MB"
                        raise InputError(what, where=file, remedy="record it without --compression-mode file")


def bound_unpacking() -> None:
    """From now on rosbags unpacks no more of a chunk or message than is allowed.

    It offers no other way: its functions are replaced by such as raise InputError.
    """
    take_all_schemas()
    rosbags = _rosbags()
    lz4, zstd = _bounded(rosbags.lz4.open), _bounded(rosbags.mcap.zstd.open)
    rosbags.bag.decompressors.update(bz2=_bounded(bz2.open), lz4=lz4)
    rosbags.mcap.DECOMPRESSORS.update(lz4=lz4, zstd=zstd)
    rosbags.folder.zstd = SimpleNamespace(open=rosbags.mcap.zstd.open, decompress=zstd)


def _rosbags() -> Any:
    import lz4.frame
    from rosbags.rosbag1 import reader as bag
    from rosbags.rosbag2 import reader as folder
    from rosbags.rosbag2 import storage_mcap as mcap

    return SimpleNamespace(lz4=lz4.frame, bag=bag, folder=folder, mcap=mcap)


def _bounded(opened: Callable[[BytesIO], Any]) -> Callable[..., bytes]:
    def unpacked(data: bytes, *_: int) -> bytes:
        most = _PIECE_BYTES + _PIECE_FACTOR * len(data)
        with opened(BytesIO(data)) as stream:
            raw: bytes = stream.read(most + 1)
        if len(raw) > most:
            raise InputError(f"{len(data)} bytes of it unpack to more than {most / 1e6:.0f} MB", remedy=_REMEDY)
        return raw

    return unpacked


def refuse_bombs(reader: Any, path: Path) -> None:
    """Raises InputError for an opened bag that holds far more than its file: chunks of an MCAP file that are open at
    once, rows of a database that are computed or share their bytes."""
    whole = [one.storage for one in reader.readers if hasattr(one, "storage")]  # a file, or a folder of several
    for storage in (each for one in whole for each in getattr(one, "storages", [one])):
        size = storage.path.stat().st_size
        most = _PIECE_BYTES + _PIECE_FACTOR * size
        chunks = getattr(storage, "chunks", ())
        opens = [(chunk.message_start_time, -chunk.uncompressed_size) for chunk in chunks]
        closes = [(chunk.message_end_time, chunk.uncompressed_size) for chunk in chunks]
        largest = -min(accumulate(size for _, size in sorted(opens + closes)), default=0)
        if largest > most:
            what = f"unpacks to {largest / 1e6:.0f} MB at once"
            raise InputError(what, where=path, remedy=_REMEDY)
        if hasattr(storage, "dbconn"):
            ((held,),) = storage.dbconn.execute("SELECT total(octet_length(data)) FROM messages")
            if held > size:
                what = f"its messages have {held / 1e6:.0f} MB, the file {size / 1e6:.3g} MB"
                raise InputError(what, where=path, remedy="it is damaged or forged: record it again")
