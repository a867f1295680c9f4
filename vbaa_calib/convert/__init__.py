"""Camera files of other programs: all formats, and the recognition of a file's format."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from vbaa_calib.camera import Camera
from vbaa_calib.camera.camera import SCHEMA as CAMERA_SCHEMA
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import is_bag, read_bytes, read_json, read_text
from vbaa_calib.rig import SCHEMA as RIG_SCHEMA
from vbaa_calib.rig import Rig
from vbaa_calib.session import read_pose

from .robots import KALIBR, ORB_SLAM, ROS
from .values import Exchanged, Format, Wanted
from .vision import CAHVOR, COLMAP, MRCAL, NUMBERS, OPENCV

_POSE_KEY = "T_reference_camera"


def _read(path: Path, _: Wanted) -> Exchanged:
    """The camera in a rig.json or camera.json; of a rig.json with its pose in the antenna frame.

    camera.json has no place of its own for a pose, nor for notes on how another program's file was read: they stand
    under `T_reference_camera` and `notes`, which `Camera.load` passes over.
    """
    data = read_json(path)
    if data.get("schema") == RIG_SCHEMA:
        rig = Rig.from_dict(data, path)
        return Exchanged(
            rig.camera, rig.T_antenna_camera, ("antenna, moment sensor and joints, with their covariance",)
        )
    if data.get("schema") != CAMERA_SCHEMA:
        raise InputError(
            f"schema is {data.get('schema')!r}",
            where=path,
            remedy=f"{RIG_SCHEMA} or {CAMERA_SCHEMA} is needed; another program's file needs --from",
        )
    pose = None if data.get(_POSE_KEY) is None else read_pose(data[_POSE_KEY], path, _POSE_KEY)
    notes = data.get("notes")
    notes = [note for note in notes if isinstance(note, str)] if isinstance(notes, list) else ()
    return Exchanged(Camera.load(path), pose, notes=tuple(notes))


def _write(exchanged: Exchanged) -> str:
    more: dict[str, Any] = {}
    if exchanged.T_reference_camera is not None:
        more[_POSE_KEY] = exchanged.T_reference_camera.to_dict()
    if exchanged.notes:
        more["notes"] = list(exchanged.notes)
    return json.dumps(exchanged.camera.to_dict() | more, indent=2, allow_nan=False) + "\n"


FORMATS = {
    each.name: each
    for each in (
        Format(
            "vbaa",
            "file of vbaa-calib",
            _read,
            _write,
            lambda text: text.lstrip().startswith("{") and (f'"{CAMERA_SCHEMA}"' in text or f'"{RIG_SCHEMA}"' in text),
            with_pose=True,
            with_covariance=True,
        ),
        *(ROS, OPENCV, KALIBR, MRCAL, COLMAP, NUMBERS, ORB_SLAM, CAHVOR),
    )
}
"""Name on the command line → format."""


def guessed(path: Path) -> Format:
    """The format that a file has by its content. Raises InputError where none or several fit."""
    if path.name == "cameras.bin":
        return COLMAP
    if is_bag(path):
        return ROS
    text = "PK" if read_bytes(path)[:2] == b"PK" else read_text(path)  # an .npz
    found = [each for each in FORMATS.values() if each.fits(text)]
    if len(found) == 1:
        return found[0]
    looks = " or ".join(each.what for each in found) or "none of the files that are known here"
    raise InputError(
        f"looks like {looks}", where=path, remedy=f"say which with --from (vbaa convert): {', '.join(FORMATS)}"
    )
