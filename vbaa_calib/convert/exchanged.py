"""A camera on its way from one file to another, and what a format is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Pose


@dataclass(frozen=True, eq=False)
class Exchanged:
    """A camera, its pose in whatever frame the file counts from (in ours the antenna's; None where there is none).

    beside : what the file holds that no other format has a place for, in words. notes : on how it was read.
    """

    camera: Camera
    T_reference_camera: Pose | None = None
    beside: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Format:
    """A file format: its name on the command line and in words, and what it has a place for.

    parse : (path, which camera of several or None) → the camera. Raises InputError naming what is wrong.
    write : camera → text. Raises InputError for a lens that the format cannot hold.
    fits : whether a text looks like this format.
    """

    name: str
    what: str
    parse: Callable[[Path, str | None], Exchanged]
    write: Callable[[Exchanged], str]
    fits: Callable[[str], bool]
    with_pose: bool = False
    with_covariance: bool = False
    several: bool = False

    def read(self, path: Path, which: str | None = None) -> Exchanged:
        """The camera in a file; `which` of several. Raises InputError naming what is wrong."""
        if which is not None and not self.several:
            raise InputError("holds one camera", where=path, remedy="leave --camera out")
        return self.parse(path, which)

    def lost(self, given: Exchanged) -> list[str]:
        """What of a camera does not get into a file of this format, in words."""
        words = list(given.beside)
        if given.T_reference_camera is not None and not self.with_pose:
            words.append("the camera's pose")
        if given.camera.covariance is not None and not self.with_covariance:
            words.append("the covariance of the lens")
        return words
