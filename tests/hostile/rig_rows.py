"""What rig.json and camera.json may say that cannot be."""

from __future__ import annotations

import json

from . import damage as d
from .case import Case, Row, cases
from .every_file import ESTIMATE
from .settings_rows import NAN

BUDGET = "budget rig.json -o out.json"

RIG: tuple[Row, ...] = (
    ("a list", d.content("[1, 2]"), "must be a JSON object"),
    ("a picture", d.copy("free.png"), "is not UTF-8 text"),
    ("the truth", d.copy("truth.json"), "schema is 'vbaa.truth/1'"),
    ("a lens alone", d.copy("camera.json"), "schema is 'vbaa.camera/1'"),
    ("cut short", d.cut(0.7), "line", "is not valid JSON"),
    ("nested 100000 deep", d.content('{"a":' + 100_000 * "["), "nested too deeply"),
    ("nested 200 deep", d.at("notes", json.loads(200 * "[" + 200 * "]")), "nested too deeply"),
    ("gravity in g", d.at("gravity_world", [0.0, 0.0, -1.0]), "gravity_world has the size 1", "m/s²"),
    ("a key twice", d.text('"schema":', '"schema": "a", "schema":'), "'schema' stands twice"),
    ("no schema", d.at("schema", d.REMOVED), "schema is None"),
    ("no camera", d.at("camera", d.REMOVED), "camera"),
    ("no covariance", d.at("joint", d.REMOVED), "joint"),
    ("kilometres", d.at("antenna.length_m", 1e3), "antenna.length_m: 1000.0 is not between 0.001 and 10"),
    ("a diameter of 0.8 m", d.at("antenna.diameter_m", 0.8), "antenna.diameter_m: 0.8 is not between 1e-06 and 0.1"),
    ("a bow of a nanometre's radius", d.at("antenna.noload.bow_yz_per_m.1", 1e9), "antenna.noload.bow_yz_per_m.1"),
    ("no gain", d.at("moment_sensor.gain", 0), "moment_sensor.gain: 0 is not between"),
    ("gain is NaN", d.at("moment_sensor.gain", NAN), "moment_sensor.gain is not a finite number"),
    ("gain of 400 digits", d.at("moment_sensor.gain", 10**400), "moment_sensor.gain"),
    ("stiffness of nothing", d.at("antenna.stiffness_Nm2", 0.0), "antenna.stiffness_Nm2"),
    ("focal length zero", d.at("camera.matrix.0.0", 0.0), "camera"),
    ("a matrix of two rows", d.at("camera.matrix", [[1, 0, 0], [0, 1, 0]]), "camera"),
    ("three coefficients", d.at("camera.distortion", [0.1, 0.1, 0.1]), "camera"),
    ("a lens that is none", d.at("camera.model", "pinhole"), "camera"),
    ("a picture of 2^40 columns", d.at("camera.image_size", [2**40, 360]), "camera"),
    ("a quaternion of zeros", d.at("T_antenna_camera.rotation_xyzw", [0, 0, 0, 0]), "T_antenna_camera"),
    ("the antenna behind the camera", d.at("T_antenna_camera.rotation_xyzw", [0, 0, 0, 1]), "in front of the camera"),
    ("the camera 1e300 m away", d.at("T_antenna_camera.translation_m", [1e300, 0, 0]), "T_antenna_camera"),
    ("a ragged covariance", d.at("joint.covariance.3", [1.0]), "joint"),
    ("a covariance that is not symmetric", d.at("joint.covariance.0.1", 1.0), "joint"),
    ("a covariance below zero", d.at("joint.covariance.0.0", -1.0), "joint"),
    ("a covariance with NaN", d.at("joint.covariance.0.0", NAN), "joint.covariance.0.0"),
    ("a parameter that nobody knows", d.at("joint.parameters.0", "colour"), "joint"),
    ("a parameter twice", d.at("joint.parameters.1", "camera_about_x_rad"), "joint"),
    ("noise of nothing", d.at("image.noise_px", 0), "image.noise_px"),
    ("weights of two colours", d.at("image.weights_bgr", [1, 1]), "image.weights_bgr"),
    ("a colour of two channels", d.at("image.colour_bgr", [1, 1]), "image.colour_bgr"),
    ("looks of several lengths", d.at("image.looks", [[90, 5]] * 7 + [[90, 80, 70, 5]]), "image.looks"),
    ("looks without a deviation", d.at("image.looks", [[90, 0]] * 8), "image.looks"),
    ("an axes' deviation of two", d.at("kinematics.axes_uncertainty.std", [0, 0]), "kinematics.axes_uncertainty"),
)
CAMERA: tuple[Row, ...] = (
    ("cut short", d.cut(0.5), "is not valid JSON"),
    ("the schema of tomorrow", d.at("schema", "vbaa.camera/2"), "looks like none"),
    ("no matrix", d.at("matrix", d.REMOVED), "matrix"),
    ("a skewed matrix", d.at("matrix.0.1", 3.0), "matrix"),
    ("a size of three", d.at("image_size", [480, 360, 3]), "image_size"),
    ("a coefficient of NaN", d.at("distortion.0", NAN), "distortion"),
    ("six coefficients", d.at("distortion", [0.0] * 6), "distortion"),
    ("a pose that is none", d.at("T_reference_camera", [1, 2]), "T_reference_camera"),
    ("a covariance of one row", d.at("covariance", [[1.0]]), "covariance"),
)

CASES: list[Case] = [
    *cases("rig.json", "rig.json", ESTIMATE, RIG),
    *cases("rig.json", "rig.json", BUDGET, RIG[::3]),
    *cases("rig.json", "rig.json", "reconstruct contacts.csv --rig rig.json -o out.vtp", RIG[1::5]),
    *cases("camera.json", "camera.json", "convert camera.json --to kalibr -o out.yaml", CAMERA),
]
