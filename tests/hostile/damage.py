"""What befalls files."""

from __future__ import annotations

import csv
import json
import os
import shutil
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from vbaa_calib.core.files import read_yaml

from .case import Damage


def nothing(path: Path) -> None:
    """The file is as it should be; the call is not."""


def gone(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def put(path: Path, data: bytes) -> None:
    """A new file in the place of the old, which may have further names."""
    gone(path)
    path.write_bytes(data)


def folder(path: Path) -> None:
    gone(path)
    path.mkdir()


def giant(size: int) -> Damage:
    """A file that says it is so many bytes long; they take no place on the disk."""

    def damage(path: Path) -> None:
        put(path, b"")
        os.truncate(path, size)

    return damage


def pipe(path: Path) -> None:
    """A FIFO that nobody writes to."""
    gone(path)
    os.mkfifo(path)


def link(target: str) -> Damage:
    """A symbolic link in the file's place, relative to its folder."""

    def damage(path: Path) -> None:
        gone(path)
        path.symlink_to(target)

    return damage


def loop(path: Path) -> None:
    link(path.name)(path)


def content(data: str | bytes) -> Damage:
    """Other contents."""

    return lambda path: put(path, data.encode() if isinstance(data, str) else data)


def changed(change: Callable[[bytes], bytes]) -> Damage:
    """The bytes changed."""

    def damage(path: Path) -> None:
        before = path.read_bytes()
        after = change(before)
        assert after != before
        put(path, after)

    return damage


def cut(share: float) -> Damage:
    return changed(lambda data: data[: int(len(data) * share)])


utf16 = changed(lambda data: data.decode().encode("utf-16"))
latin1 = changed(lambda data: data + "# für".encode("latin-1"))
zeros = changed(lambda data: bytes(len(data)))
noise = changed(lambda data: np.random.default_rng(1).bytes(min(len(data), 4096)))


def text(old: str, new: str) -> Damage:
    """One place of a text changed."""
    return changed(lambda data: data.replace(old.encode(), new.encode(), 1))


def cell(line: int, column: str, value: str) -> Damage:
    """One cell of a CSV set; lines count from 1, the header."""

    def damage(path: Path) -> None:
        rows = list(csv.reader(path.read_text().splitlines()))
        rows[line - 1][rows[0].index(column)] = value
        put(path, ("\n".join(map(",".join, rows)) + "\n").encode())

    return damage


REMOVED = object()
"""In place of a value: the key is taken out."""


def at(key: str, value: Any) -> Damage:
    """A value of a YAML or JSON file set; `key` as "board.square_m" or "gravity_world.0"."""

    def damage(path: Path) -> None:
        data = place = json.loads(path.read_text()) if path.suffix == ".json" else read_yaml(path)
        *way, last = (int(part) if part.lstrip("-").isdigit() else part for part in key.split("."))
        for part in way:
            place = place[part]
        if value is REMOVED:
            del place[last]
        else:
            place[last] = value
        put(path, (json.dumps(data) if path.suffix == ".json" else yaml.safe_dump(data)).encode())

    return damage


def encoded(suffix: str, change: Callable[[np.ndarray], np.ndarray] = np.copy, *options: int) -> Damage:
    """The picture, or all of a folder, changed and encoded in another format, under the same name."""

    def damage(path: Path) -> None:
        for one in sorted(path.glob("*.png")) if path.is_dir() else [path]:
            done, data = cv2.imencode(suffix, change(cv2.imread(str(one), cv2.IMREAD_UNCHANGED)), list(options))
            assert done
            put(one, data.tobytes())

    return damage


grey = encoded(".png", lambda picture: np.full_like(picture, 90))
specks = encoded(".png", lambda one: np.random.default_rng(1).normal(90, 12, one.shape).clip(0, 255).astype(np.uint8))
halved = encoded(".png", lambda picture: cv2.resize(picture, (picture.shape[1] // 2, picture.shape[0] // 2)))


def png(width: int, height: int, rows: bytes, *, bits: int = 8, colour: int = 0, extra: bytes = b"") -> bytes:
    """A PNG that announces this size, over any data; `extra` are chunks before the data."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + extra + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def copy(source: str) -> Damage:
    """Another file of the folder in its place; `source` relative to the file's folder."""
    return lambda path: put(path, (path.parent / source).read_bytes())


def several(*damages: Damage) -> Damage:
    def damage(path: Path) -> None:
        for one in damages:
            one(path)

    return damage


def beside(name: str, damage: Damage) -> Damage:
    """Done to another file, relative to the one that is named."""
    return lambda path: damage(path.parent / name)
