"""A good session.yaml and good tables, and what is said of them once they are changed."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from vbaa_calib.core.errors import InputError


def pose() -> dict[str, Any]:
    """A turn about y by 2·atan(0.75), as a session.yaml gives it."""
    return {"translation_m": [0.1, 0.2, 0.3], "rotation_xyzw": [0.0, 0.6, 0.0, 0.8]}


GOOD: dict[str, Any] = {
    "schema": "vbaa.session/1",
    "board": {
        "type": "charuco",
        "squares_x": 9,
        "squares_y": 6,
        "square_m": 0.012,
        "marker_m": 0.009,
        "dictionary": "DICT_4X4_100",
        "legacy_pattern": False,
        "thickness_m": 0.002,
    },
    "antenna": {"length_m": 0.24, "diameter_m": 0.0008, "youngs_modulus_Pa": 193.0e9, "density_kg_m3": 7900.0},
    "jig": {"T_antenna_board": pose()},
    "kinematics": {"T_actuator_antenna": pose(), "position_world_m": [0.0, 0.0, 0.15]},
    "gravity_world": [0.0, 0.0, -9.80665],
    "moment_sensor": {"std_Nm": 2.0e-5},
}
NOLOAD = "image,pan_rad,tilt_rad,moment_Nm\na.png,0.1,0.2,1e-3\nb.png,0,-0.2,0\n"
LOADS = (
    "image,pan_rad,tilt_rad,moment_Nm,distance_m,force_y_N,force_z_N\n"
    "a.png,0,0.1,1e-3,0.1,0.02,0\nb.png,0,0,0,0.24,0,-0.01\n"
)
RECORDING = "frame,time_s,image,pan_rad,tilt_rad,moment_Nm\n3,0.0,a.png,0.1,0.2,1e-3\n1,0.1,b.png,0,0,0\n"
CENTRELINES = "frame,u_px,v_px,sigma_px\n1,10.5,20,0.1\n3,1,2,0.2\n1,11,21,0.3\n"


def changed(*keys: str | int, to: Any = None, drop: bool = False) -> dict[str, Any]:
    """session.yaml with one key set or left out."""
    data = copy.deepcopy(GOOD)
    place = data
    for key in keys[:-1]:
        place = place[key]
    if drop:
        del place[keys[-1]]
    else:
        place[keys[-1]] = to
    return data


def write(root: Path, data: Any) -> Path:
    path = root / "session.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


def complaint(action: Callable[[], object], path: Path) -> str:
    """What is said: one line that begins with the file and ends in a remedy."""
    with pytest.raises(InputError) as caught:
        action()
    text = str(caught.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    assert caught.value.remedy
    assert text.endswith(caught.value.remedy)
    return text


def nodes(data: Any, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Paths to everything in a file, mappings and lists included."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    return [*([path] if path else []), *(found for key, value in items for found in nodes(value, (*path, key)))]
