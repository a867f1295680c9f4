"""A camera on its way from one file to another, and what a format is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from vbaa_calib.camera import Camera
from vbaa_calib.geometry import Pose


@dataclass(frozen=True, eq=False)
class Exchanged:
    """A camera, with its pose where the file has one.

    Attributes
    ----------
    T_reference_camera : pose of the camera in whatever frame the file counts from (in ours the antenna's).
    beside : what else the file holds that no other format has a place for, in words; empty for nothing.
    notes : what a person should know of how the file was read.
    """

    camera: Camera
    T_reference_camera: Pose | None = None
    beside: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Format:
    """A file format.

    Attributes
    ----------
    name : on the command line. what : in words.
    read : (path, which camera of several or None) → the camera. Raises InputError naming what is wrong.
    write : camera → text. Raises InputError for a lens that the format cannot hold.
    fits : whether a text looks like this format.
    with_pose, with_covariance : whether the format has a place for them.
    """

    name: str
    what: str
    read: Callable[[Path, str | None], Exchanged]
    write: Callable[[Exchanged], str]
    fits: Callable[[str], bool]
    with_pose: bool = False
    with_covariance: bool = False

    def lost(self, given: Exchanged) -> list[str]:
        """What of a camera does not get into a file of this format, in words."""
        words = list(given.beside)
        if given.T_reference_camera is not None and not self.with_pose:
            words.append("the camera's pose")
        if given.camera.covariance is not None and not self.with_covariance:
            words.append("the covariance of the lens")
        return words
