"""rig.json and camera.json. Of rig.json the camera and its pose in the antenna frame are taken.

camera.json has no place of its own for a pose; one that another program's file brought along stands under
`T_reference_camera`, which `Camera.load` passes over.
"""

from __future__ import annotations

import json
from pathlib import Path

from vbaa_calib.camera import Camera
from vbaa_calib.camera.camera import SCHEMA as CAMERA_SCHEMA
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_json
from vbaa_calib.rig import Rig
from vbaa_calib.rig.rig_file import SCHEMA as RIG_SCHEMA
from vbaa_calib.session import read_pose

from .values import Exchanged, Format

_POSE_KEY = "T_reference_camera"
_OF_RIG = ("antenna, moment sensor and joints, with their covariance",)


def _read(path: Path, _: str | None) -> Exchanged:
    data = read_json(path)
    if data.get("schema") == RIG_SCHEMA:
        rig = Rig.from_dict(data, path)
        return Exchanged(rig.camera, rig.T_antenna_camera, _OF_RIG)
    if data.get("schema") != CAMERA_SCHEMA:
        raise InputError(
            f"schema is {data.get('schema')!r}",
            where=path,
            remedy=f"{RIG_SCHEMA} or {CAMERA_SCHEMA} is needed; another program's file needs --from",
        )
    pose = None if data.get(_POSE_KEY) is None else read_pose(data[_POSE_KEY], path, _POSE_KEY)
    return Exchanged(Camera.load(path), pose)


def _write(given: Exchanged) -> str:
    pose = {} if given.T_reference_camera is None else {_POSE_KEY: given.T_reference_camera.to_dict()}
    return json.dumps(given.camera.to_dict() | pose, indent=2, allow_nan=False) + "\n"


def _fits(text: str) -> bool:
    return text.lstrip().startswith("{") and (f'"{CAMERA_SCHEMA}"' in text or f'"{RIG_SCHEMA}"' in text)


FORMAT = Format("vbaa", "rig.json, camera.json", _read, _write, _fits, with_pose=True, with_covariance=True)
