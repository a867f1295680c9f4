"""A camera at this computer: "camera:0", "camera:/dev/video2", "camera:0?width=1920&height=1080&fourcc=MJPG"."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Container
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

import cv2

from vbaa_calib.core.errors import InputError

from .live import Fault, LiveSource, Patience, silence_opencv
from .picture import shown

_KEYS = "width, height, fps and fourcc"
_LIKE = "write it like camera:0 or camera:0?width=1920&height=1080&fourcc=MJPG"
_MOST = {"width": 65535, "height": 65535, "fps": 1000}
_PLUG = "check cable and plug, close other programs that use the camera, then run this again: it goes on where it was"
_FAULTS: dict[Fault, tuple[str, str]] = {
    "closed": ("the camera cannot be opened", "close other programs that use it, or name another camera"),
    "blank": (
        "the camera opens but gives no picture",
        "close other programs that use it, try another size or fourcc=MJPG, or name another camera",
    ),
    "broken": ("the camera gives no more pictures", _PLUG),
    "hung": ("the camera does not answer", _PLUG),
}


@dataclass(frozen=True)
class CameraSettings:
    """Which camera (OpenCV's index, or a device file), and what is asked of it; None: the camera's default.

    Many cameras are slow at full size without a fourcc such as MJPG.
    """

    device: int | str
    width: int | None = None
    height: int | None = None
    fps: int | None = None
    fourcc: str | None = None


def parse_camera(text: str) -> CameraSettings:
    """What stands behind "camera:". Raises InputError."""
    device, _, query = text.partition("?")
    where, given = f"camera:{shown(text)}", dict[str, Any]()
    for key, value in parse_qsl(query, keep_blank_values=True):
        if key == "fourcc" and re.fullmatch(r"[\x20-\x7e]{4}", value):
            given[key] = value
        elif key in _MOST and re.fullmatch(r"[0-9]{1,5}", value) and 1 <= int(value) <= _MOST[key]:
            given[key] = int(value)
        else:
            known = key in _MOST or key == "fourcc"
            what = f"{shown(key)} cannot be {shown(value)!r}" if known else f"{shown(key)!r} is not known of a camera"
            raise InputError(what, where=where, remedy=f"{_KEYS} can be asked for; {_LIKE}")
    number = re.fullmatch(r"[0-9]{1,3}", device)
    if not number and not device.startswith("/"):
        raise InputError("is neither a camera's number nor its device", where=where, remedy=_LIKE)
    return CameraSettings(int(device) if number else device, **given)


def _list_cameras() -> list[str]:
    """The camera devices that this computer shows, with their names where the system knows them; Linux only."""
    found = []
    for path in sorted(Path("/dev").glob("video*"), key=lambda path: (len(path.name), path.name)):
        try:
            title = (Path("/sys/class/video4linux") / path.name / "name").read_text(errors="replace").strip()
        except OSError:
            title = ""
        found.append(f"{path} ({title})" if title else str(path))
    return found


def open_camera(settings: CameraSettings, seen: Container[str] = (), patience: Patience | None = None) -> LiveSource:
    """A camera, running. Raises InputError when it is not there or gives no picture."""
    name, notes = f"camera:{settings.device}", list[str]()
    _check_device(settings.device, name)

    def opened() -> cv2.VideoCapture:
        silence_opencv()
        backend = cv2.CAP_V4L2 if sys.platform.startswith("linux") else cv2.CAP_ANY
        capture = cv2.VideoCapture(settings.device, backend)
        if capture.isOpened():
            exposure = "the camera's automatic exposure is left as it is"
            notes[:] = [_ask_size(capture, settings), _stop_autofocus(capture), exposure]
        return capture

    source = LiveSource(name, opened, patience or Patience(), _FAULTS, seen)
    source.add_notes(*notes)
    return source


def _check_device(device: int | str, name: str) -> None:
    """On Linux a camera is a file, so that what is missing is known without asking the driver."""
    if not sys.platform.startswith("linux"):
        return
    path = Path(f"/dev/video{device}" if isinstance(device, int) else device)
    if not path.exists():
        there = _list_cameras()
        remedy = f"there are {', '.join(there)}" if there else "this computer shows no camera: plug one in"
        raise InputError(f"there is no {shown(str(path))}", where=name, remedy=remedy)
    if not os.access(path, os.R_OK | os.W_OK):
        remedy = "let the user use cameras, usually `sudo usermod -aG video $USER`, then log in again"
        raise InputError(f"{path} may not be used", where=name, remedy=remedy)


def _ask_size(capture: cv2.VideoCapture, settings: CameraSettings) -> str:
    # the pixel format first: it decides which sizes there are
    if settings.fourcc:
        capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*settings.fourcc))
    sides = {cv2.CAP_PROP_FRAME_WIDTH: settings.width, cv2.CAP_PROP_FRAME_HEIGHT: settings.height}
    for key, value in {**sides, cv2.CAP_PROP_FPS: settings.fps}.items():
        if value:
            capture.set(key, value)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    has = [int(capture.get(key)) for key in sides]
    if all(asked in (None, given) for asked, given in zip(sides.values(), has, strict=True)):
        return f"the camera gives {has[0]}x{has[1]} px"
    asked_for = "x".join(str(value or "any") for value in sides.values())
    return f"{asked_for} px were asked for, but the camera gives {has[0]}x{has[1]} px"


def _stop_autofocus(capture: cv2.VideoCapture) -> str:
    if capture.set(cv2.CAP_PROP_AUTOFOCUS, 0) and capture.get(cv2.CAP_PROP_AUTOFOCUS) == 0:
        return "autofocus is switched off"
    return (
        "autofocus could not be switched off; if the camera has one, switch it off in its own program, "
        "since a lens that focuses anew is another lens"
    )
