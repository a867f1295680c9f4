"""What is true of a simulated session, as plain data for truth.json."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..antenna.rod import Rod
from ..geometry import Pose
from .scene import Scene
from .touch import Touch

SCHEMA = "vbaa.truth/1"


def frame_truth(scene: Scene, touched: Touch, index: int, T_world_antenna: Pose) -> dict[str, Any]:
    """What is true of one frame; None where there is no contact."""
    if not touched.in_contact[index]:
        names = (
            "distance_m",
            "contact_antenna_m",
            "contact_world_m",
            "touched_world_m",
            "normal_world",
            "indentation_m",
        )
        return {
            "in_contact": False,
            **dict.fromkeys(names),
            "force_N": [0.0, 0.0, 0.0],
            "sticks": False,
            "slip_world_m": None,
        }
    contact = T_world_antenna @ touched.contact_antenna_m[index]
    surface, normal = touched.touched_world_m[index], touched.normal_world[index]
    return {
        "in_contact": True,
        "distance_m": float(touched.contact_m[index]),
        "force_N": touched.force_antenna_N[index].tolist(),
        "contact_antenna_m": touched.contact_antenna_m[index].tolist(),
        "contact_world_m": contact.tolist(),
        "touched_world_m": surface.tolist(),
        "normal_world": normal.tolist(),
        "indentation_m": float(np.maximum(scene.radius_m - (contact - surface) @ normal, 0.0)),
        "sticks": bool(touched.sticks[index]),
        "slip_world_m": touched.slip_world_m[index].tolist(),
    }


def rig_truth(scene: Scene, rod: Rod) -> dict[str, Any]:
    """The rig, its sensors and the object, in the units that their names say."""
    obj = scene.object
    rigid = not np.isfinite(obj.stiffness_N_m)
    return {
        "schema": SCHEMA,
        "scene": scene.name,
        "seed": scene.seed,
        "camera": {
            "model": scene.lens.model,
            "image_size": list(scene.lens.image_size),
            "matrix": scene.lens.matrix.tolist(),
            "distortion": scene.lens.distortion.tolist(),
        },
        "T_antenna_camera": scene.T_antenna_camera.to_dict(),
        "stiffness_Nm2": rod.bending_stiffness_Nm2,
        "antenna": {
            "length_m": rod.length_m,
            "diameter_m": scene.antenna.diameter_m,
            "torsional_stiffness_Nm2": rod.torsional_stiffness_Nm2,
            "mass_per_length_kg_m": rod.mass_per_length_kg_m,
            "T_antenna_clamp": rod.T_antenna_clamp.to_dict(),
            "clamp_angle_rad": scene.true.clamp_angle_rad.tolist(),
            "natural_curvature_per_m": rod.natural_curvature_per_m.tolist(),
        },
        "moment_sensor": {
            "gain": scene.moment.gain,
            "offset_Nm": scene.moment.offset_Nm,
            "std_Nm": scene.moment.std_Nm,
        },
        "object": {
            "shape": obj.shape,
            "center_world_m": obj.center_world_m.tolist(),
            "axis_world": obj.axis_world.tolist(),
            "wedge_world": obj.wedge_world.tolist(),
            "radius_m": obj.radius_m,
            "half_length_m": obj.half_length_m,
            "stiffness_N_m": None if rigid else obj.stiffness_N_m,
            "friction": obj.friction,
            "bumps": [
                {"direction_world": one.direction_world.tolist(), "height_m": one.height_m, "width_m": one.width_m}
                for one in obj.bumps
            ],
        },
    }
