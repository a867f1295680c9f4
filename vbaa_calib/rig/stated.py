"""A stated rig, from whiskers.yaml instead of a calibration."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from vbaa_calib.antenna.shape import PARAMETERS as ANTENNA_PARAMETERS
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_yaml
from vbaa_calib.core.models import checked
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.session.whiskers import StatedAntenna, StatedFile

from .parts import RIG_PARAMETERS, SCHEMA, Antenna, kinematics_to_dict


def _antenna(stated: StatedAntenna) -> dict[str, Any]:
    """A stated antenna's entry in the form of rig.json."""
    values, std = np.zeros((2, len(ANTENNA_PARAMETERS)))
    values[5], values[6:8] = stated.bow_per_m, np.log(stated.wire)
    std[5:8] = stated.bow_std_per_m or 1.0 / stated.length_m, stated.stiffness_std, stated.mass_std
    return Antenna(stated.length_m, stated.diameter_m, values).stated(std)


def stated_rig(path: Path) -> dict[str, Any]:
    """The rig in a YAML file (`StatedFile`) in the form of rig.json. World frame: origin in the picture's middle in
    the antennas' plane, x to the right, y up, z to the camera. Raises InputError naming the key that is wrong."""
    known = read_yaml(path)
    if known.get("schema") != StatedFile.VERSION:
        remedy = f"give rig.json of `vbaa calibrate`, or a file of {StatedFile.VERSION}"
        raise InputError(f"is no rig: schema is {known.get('schema')!r}", where=path, remedy=remedy)
    read = checked(StatedFile, known, path, "`vbaa schema whiskers` prints what is expected")
    view, (width, height) = read.camera, read.camera.centre_px
    antennas = {name: _antenna(each) for name, each in read.antennas.items()}
    matrix = [[view.focal_px, 0.0, width], [0.0, view.focal_px, height], [0.0, 0.0, 1.0]]
    lens = {"image_size": list(view.image_size), "matrix": matrix, "distortion": view.distortion}
    std = np.zeros(len(RIG_PARAMETERS))
    std[RIG_PARAMETERS.index("camera_z_m")] = view.scale_std * view.distance_m
    return {
        "schema": SCHEMA,
        "camera": {"schema": "vbaa.camera/1", "model": "opencv", **lens},
        "T_antenna_camera": Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, view.distance_m])).to_dict(),
        "antenna": next(iter(antennas.values())),
        "moment_sensor": None,
        "kinematics": kinematics_to_dict(Kinematics()),
        "gravity_world": read.gravity_world.tolist(),
        "image": {"noise_px": read.noise_px, "noise_scale": 1.0, "bright": None},
        "joint": {"parameters": list(RIG_PARAMETERS), "covariance": np.diag(std**2).tolist()},
        "drift": "none",
        "clamp": asdict(read.clamp),
        "antennas": antennas,
    }
