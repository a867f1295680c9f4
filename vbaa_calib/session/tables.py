"""A session's CSV tables: no row is taken on trust."""

from __future__ import annotations

import os
from collections.abc import Iterable
from itertools import chain
from pathlib import Path
from typing import Any

from vbaa_calib.core.csv_rows import csv_rows, number, read_csv, whole_number
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.images import SUFFIXES

from .rows import (
    Frame,
    Load,
    Still,
    SweepPicture,
    joints,
    picture,
    reading,
    refuse_misspelt,
    refuse_repeated_pictures,
    require,
    still,
    view,
    wrong,
)
from .settings import Session

FOLDERS = ("intrinsics", "plane", "sweep", "over", "noload", "loads", "recording")
FILES = ("session.yaml", "board.yaml", "truth.json", "wizard.json")
TABLES = ("recording.csv", "centrelines.csv", "sweep.csv", "noload.csv", "loads.csv")


def refuse_measured(output: Path, root: Path) -> None:
    """Raises InputError where `output` is a file of the session in `root` that holds measurements, even by force."""
    if not os.path.lexists(output):
        return
    place, inside = Path(os.path.realpath(output)), Path(os.path.realpath(root))
    if not place.is_relative_to(inside):
        return
    *folders, name = place.relative_to(inside).parts or ("",)
    taken = Path(name).suffix.lower() in SUFFIXES or name in TABLES
    if (not folders and name in FILES) or (folders and folders[0] in FOLDERS and taken):
        raise InputError("is an input of this command", where=output, remedy="take another name")


def check_pictures(pictures: Iterable[Path], image_size: tuple[int, int], whose: str) -> None:
    """Raises InputError for the first picture that cannot be read or has another size than (width, height) px.

    Decoding is quick: better all of it before the long work than an error in the middle of it.
    """
    from vbaa_calib.core.images import read_gray

    for path in pictures:
        height, width = read_gray(path).shape
        if (width, height) != tuple(image_size):
            what = f"is {width}x{height} px, {whose} {image_size[0]}x{image_size[1]} px"
            raise InputError(what, where=path, remedy="use one camera at one resolution throughout")


_MOMENTS = ("moment_Nm", "moment_z_Nm")
"""Columns of a recording that may be missing."""


def read_sweep(session: Session) -> list[SweepPicture]:
    """sweep/sweep.csv: a board fixed in the world, seen while the joints move, a picture a row."""
    path = session.root / "sweep" / "sweep.csv"
    require(path, "it gives the joint angles of every picture of the sweep")
    rows = read_csv(path, ("image", "pan_rad", "tilt_rad"))
    pictures = [SweepPicture(image=picture(row, path), **joints(row, path)) for row in rows]
    refuse_repeated_pictures([seen.image for seen in pictures], rows, path)
    return pictures


def read_noload(session: Session) -> list[Still]:
    """noload/noload.csv: the free antenna, a picture a row."""
    path = session.root / "noload" / "noload.csv"
    require(path, "calibration needs the free antenna")
    rows = read_csv(path, ("image", "pan_rad", "tilt_rad", "moment_Nm"), ("time_s",))
    stills = [Still(**still(row, path)) for row in rows]
    refuse_repeated_pictures([seen.image for seen in stills], rows, path)
    return stills


def read_loads(session: Session) -> list[Load]:
    """loads/loads.csv: known loads, each on the antenna, a picture a row."""
    path = session.root / "loads" / "loads.csv"
    require(path, "calibration needs known loads, for the stiffness")
    names = ("distance_m", "force_y_N", "force_z_N")
    rows = read_csv(path, ("image", "pan_rad", "tilt_rad", "moment_Nm", *names), ("time_s",))
    loads = [Load(**(still(row, path) | {name: number(row, name, path) for name in names})) for row in rows]
    length_m = session.antenna.length_m
    for row, load in zip(rows, loads, strict=True):
        if not 0 < load.distance_m <= length_m:
            what = f"distance_m is {load.distance_m:g}, the antenna {length_m:g} m long"
            raise wrong(row, path, what, "give metres from the clamp along the antenna")
        if load.force_y_N == load.force_z_N == 0:
            raise wrong(row, path, "the force is zero", "free frames belong into noload/")
    refuse_repeated_pictures([load.image for load in loads], rows, path)
    return loads


def read_recording(session: Session) -> list[Frame]:
    """recording/recording.csv. With recording/centrelines.csv instead of pictures it needs no image column.

    Moments may be missing, in a cell or as a column: the frame is then seen but not felt.
    """
    path = session.root / "recording" / "recording.csv"
    require(path, "it names the frames of the recording")
    with_images = not (path.parent / "centrelines.csv").exists()
    columns = ("frame", "time_s", *(("image",) if with_images else ()), "pan_rad", "tilt_rad")
    rows = csv_rows(path, columns, _MOMENTS)
    first = next(rows)
    refuse_misspelt(path, _MOMENTS[0], (*columns, *_MOMENTS))
    frames: list[Frame] = []
    seen: set[int] = set()
    for row in chain([first], rows):
        moments: dict[str, Any] = {name: reading(row, name, path) for name in _MOMENTS}
        frame = Frame(**view(row, path, with_images), **moments, frame=whole_number(row, "frame", path))
        if frame.frame in seen:
            raise wrong(row, path, f"frame {frame.frame} stands twice", "every frame needs its own number")
        if frames and frame.time_s < frames[-1].time_s:
            raise wrong(row, path, "the time runs backwards", "sort the rows by time_s")
        seen.add(frame.frame)
        frames.append(frame)
    return frames
