"""A camera in exchange between programs, and checks of the values in their files."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError, about, quoted
from vbaa_calib.geometry import Pose

from .refit import PROJECTIONS, refitted


@dataclass(frozen=True)
class Wanted:
    """Selection from a lens file that has several cameras, or pictures unlike those to be used.

    which : the camera, by its name in the file. size : (width, height) px, for files that state none.
    binning : pixels of the file's pictures that are one of ours, across and down; roi : left, top, width, height of
    the part of them that ours are; None: as the file says. rectified : ours were rectified, with the file's projection.
    fisheye : of four coefficients, whether they are a fisheye's; None: as the file says.
    """

    which: str | None = None
    size: tuple[int, int] | None = None
    binning: tuple[int, int] | None = None
    roi: tuple[int, int, int, int] | None = None
    rectified: bool = False
    fisheye: bool | None = None

    @staticmethod
    def of(flags: Mapping[str, Any]) -> Wanted:
        """The selection by the flags of a lens file. Raises InputError for an invalid size, binning or part."""
        size = _pair(flags.get("size"), "--size", "1280x960")
        binning, roi = _pair(flags.get("binning"), "--binning", "2, or 2x1"), flags.get("roi")
        whole = roi is None or (len(roi) == 4 and all(float(side).is_integer() for side in roi))
        if roi is not None and (not whole or min(*roi[:2], roi[2] - 1, roi[3] - 1) < 0):
            words = " ".join(f"{side:g}" for side in roi)
            raise InputError(f"--roi is {words}", remedy="give left, top, width and height in pixels")
        part = None if roi is None else (int(roi[0]), int(roi[1]), int(roi[2]), int(roi[3]))
        return Wanted(flags.get("camera_name"), size, binning, part, bool(flags.get("rectified")), flags.get("fisheye"))

    def one_of(self, names: Sequence[str], path: Path) -> str:
        """The name of the chosen camera. Raises InputError where there is none, or several and no choice."""
        which = self.which
        if not names:
            raise InputError("holds no camera", where=path, remedy="is it the file that is meant?")
        if which is None and len(names) > 1:
            raise InputError(f"holds {', '.join(names):.60}", where=path, remedy="say which with --camera-name NAME")
        if which is not None and which not in names:
            raise InputError(f"holds no camera {which:.20}", where=path, remedy=f"it holds {', '.join(names):.60}")
        return which or names[0]

    def size_of(self, sides: Sequence[tuple[str, Any]], path: Path) -> tuple[int, int]:
        """(width, height) px as the file states them, or as selected. Raises InputError where both are missing or
        they differ."""
        if all(value is None for _, value in sides):
            if self.size is None:
                raise InputError("does not state the picture's size", where=path, remedy="give --size WIDTHxHEIGHT")
            return self.size
        size = size_of(sides, path)
        if self.size not in (None, size):
            what = "states a picture of {}x{} px, not {}x{}".format(*size, *(self.size or size))
            raise InputError(what, where=path, remedy="leave --size out")
        return size


def _pair(text: str | None, flag: str, like: str) -> tuple[int, int] | None:
    if text is None:
        return None
    found = re.fullmatch(r"([1-9]\d{0,5})(?:[xX,]([1-9]\d{0,5}))?", text.strip())
    if found is None or (flag == "--size" and found[2] is None):
        raise InputError(f"{flag} is {text!r}", remedy=f"give it like {like}")
    return int(found[1]), int(found[2] or found[1])


@dataclass(frozen=True, eq=False)
class Exchanged:
    """A camera and its pose in the file's reference frame (in ours the antenna frame); None without a pose.

    others : contents that no other format can hold, in words. notes : on how the file was read.
    binning, roi : of the file's own pictures, as in `Wanted`.
    """

    camera: Camera
    T_reference_camera: Pose | None = None
    others: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    binning: tuple[int, int] = (1, 1)
    roi: tuple[int, int, int, int] | None = None

    @staticmethod
    def of(model: str, size: tuple[int, int], matrix: np.ndarray, coefficients: ArrayLike, path: Path) -> Exchanged:
        """A camera from its matrix (3, 3) and coefficients; one with a skew is refitted, with a note on its error.

        Raises InputError naming the file.
        """
        skew = float(matrix[0, 1])
        camera = checked(model, size, matrix * [[1, 0, 1], [1, 1, 1], [1, 1, 1]], coefficients, path)
        if not skew:
            return Exchanged(camera)
        name = f"{model} with a skew of {skew:g} px"
        camera, words = refitted(PROJECTIONS["skewed"](camera, skew), size, name, path)
        return Exchanged(camera, notes=(words,))


@dataclass(frozen=True)
class Format:
    """A file format: its name on the command line and in words, and what it can store.

    parse : path and `Wanted` → `Exchanged`. write : `Exchanged` → text; None for a format that is only read. Both raise
        InputError. fits : whether a text looks like this format.
    takes : fields of `Wanted` that only some formats know: which, size, rectified, fisheye.
    """

    name: str
    what: str
    parse: Callable[[Path, Wanted], Exchanged]
    write: Callable[[Exchanged], str] | None
    fits: Callable[[str], bool]
    with_pose: bool = False
    with_covariance: bool = False
    takes: tuple[str, ...] = ()

    def read(self, path: Path, wanted: Wanted = Wanted()) -> Exchanged:
        """The camera in a file. Raises InputError naming what is wrong."""
        if wanted.which is not None and "which" not in self.takes:
            raise InputError("holds one camera", where=path, remedy="leave --camera-name out")
        if wanted.fisheye is not None and "fisheye" not in self.takes:
            raise InputError(f"{self.what} states its lens model", where=path, remedy="leave --fisheye out")
        if wanted.size is not None and "size" not in self.takes:
            raise InputError(f"{self.what} states the picture's size", where=path, remedy="leave --size out")
        if wanted.rectified and "rectified" not in self.takes:
            what = f"{self.what} does not say how pictures are rectified"
            remedy = "write down the matrix they were rectified with, without distortion, or calibrate from them"
            raise InputError(what, where=path, remedy=remedy)
        found = self.parse(path, wanted)
        binning, roi = wanted.binning or found.binning, wanted.roi or found.roi
        if binning == (1, 1) and roi is None:
            return found
        with about(path):
            camera = found.camera.part(binning, roi)
        size, whole = ("x".join(map(str, each.image_size)) for each in (camera, found.camera))
        words = f"binning {binning[0]}x{binning[1]}" + (
            "" if roi is None else " of {2}x{3} px at ({0}, {1})".format(*roi)
        )
        note = f"{words}: the lens is that of pictures of {size} px; --binning 1 takes it at {whole} px"
        return replace(found, camera=camera, notes=(*found.notes, note))

    def lost(self, exchanged: Exchanged) -> list[str]:
        """What a file of this format cannot store of a camera, in words."""
        words = list(exchanged.others)
        if exchanged.T_reference_camera is not None and not self.with_pose:
            words.append("the camera's pose")
        if exchanged.camera.covariance is not None and not self.with_covariance:
            words.append("the covariance of the lens")
        return words


def stated(camera: Camera, models: Mapping[tuple[str, int], str], program: str) -> tuple[str, list[float]]:
    """The lens model's name in another program, and its coefficients, padded with zeros.

    models : our model and a number of coefficients → the name. If the camera's number has none, the smallest number
    that holds all its nonzero coefficients is taken. Raises InputError where there is none, with the error that leaving
    some out would cause.
    """
    values = camera.distortion.tolist()
    needed = max((index + 1 for index, value in enumerate(values) if value != 0.0), default=0)
    counts = sorted(count for model, count in models if model == camera.model)
    if not counts:
        what = f"{program} has no equidistant fisheye lens (k1 to k4 over the angle)"
        raise InputError(what, remedy="choose another format, or calibrate with another lens model (`--lens-model`)")
    fitting = [count for count in counts if count >= needed]
    if fitting:
        count = len(values) if len(values) in fitting else fitting[0]
        return models[camera.model, count], values[:count] + [0.0] * (count - len(values))
    longest = counts[-1]
    named = list(zip(camera.parameter_names[4:], values, strict=True))
    beyond = [f"{name} = {value:g}" for name, value in named[longest:] if value != 0.0]
    cost = _left_out_px(camera, longest)
    words = f"it would be off by up to {cost:.2g} px without them" if np.isfinite(cost) else "they matter"
    raise InputError(
        f"{program} holds {longest} coefficients at most, this lens has {', '.join(beyond)} too: {words}",
        remedy="choose another format, or calibrate with a simpler lens (`--lens-model`)",
    )


def _left_out_px(camera: Camera, count: int) -> float:
    """Largest shift of picture points, px, if only `count` coefficients are kept without a new fit; NaN if unknown."""
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, 41), np.linspace(0, height - 1, 31))
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2)
    rays, seen = camera.unproject(pixels)
    short = Camera(camera.model, camera.image_size, camera.matrix, camera.distortion[:count])
    moved, there = short.project(np.where(seen[:, None], rays, [0.0, 0.0, 1.0]))
    off = np.linalg.norm(moved - pixels, axis=1)[seen & there]
    return float(off.max()) if len(off) else float("nan")


def size_of(sides: Sequence[tuple[str, Any]], path: Path) -> tuple[int, int]:
    """(width, height) px from two keys and their values. Raises InputError for what is not a whole number."""
    for key, value in sides:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        # as in the schema of rig.json
        if not number or not 0 < value <= 100_000 or value != int(value):
            remedy = "a picture's side in whole pixels is needed"
            raise InputError(f"{key} is {quoted(value)}", where=path, remedy=remedy)
    (_, width), (_, height) = sides
    return int(width), int(height)


def one_of(value: Any, known: Iterable[str], key: str, path: Path) -> str:
    """A value that must be one of the known names. Raises InputError for another."""
    if not isinstance(value, str) or value not in known:
        raise InputError(f"{key} is {value!r:.60}", where=path, remedy=f"one of {', '.join(known)} is needed")
    return value


def numbers(values: Any, key: str, path: Path, counts: Sequence[int], most: float = 1e300) -> list[float]:
    """A flat list of numbers within ±most, as many as one of `counts`."""
    if not isinstance(values, list | tuple) or len(values) not in counts:
        wanted = " or ".join(map(str, counts))
        raise InputError(f"{key} is {quoted(values)}", where=path, remedy=f"a list of {wanted} numbers is needed")
    for value in values:
        # a whole number may be too large for a float
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < most:
            raise InputError(f"{key} holds {quoted(value)}", where=path, remedy=f"numbers below {most:g} are needed")
    return [float(value) for value in values]


def checked(model: str, size: tuple[int, int], matrix: ArrayLike, coefficients: ArrayLike, path: Path) -> Camera:
    """A camera from its matrix (3, 3), or fx, fy, cx, cy, and its coefficients. Raises InputError naming the file."""
    if np.shape(matrix) == (4,):
        fx, fy, cx, cy = np.asarray(matrix, float)
        matrix = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
    with about(path):
        return Camera(model, size, np.array(matrix, float), np.array(coefficients, float))
