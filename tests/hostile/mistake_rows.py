"""What a file may say that is a number, a text and a table, and cannot be all the same: one row each.

That what is no number, text or table is refused is a law: `tests/fuzz/test_fuzz.py`.
"""

from __future__ import annotations

import json

from . import damage as d
from .case import Case, Row, cases
from .every_file import CALIBRATE, CALIBRATE_SWEPT, CHECK, ESTIMATE, HANDEYE, REFINE

SESSION: tuple[Row, ...] = (
    ("another file", d.copy("truth.json"), "schema is 'vbaa.truth/1'"),
    (
        "a billion laughs",
        d.changed(
            lambda data: (
                data
                + b"a0: &a0 [1]\n"
                + b"".join(b"a%d: &a%d [%s]\n" % (k + 1, k + 1, b",".join([b"*a%d" % k] * 10)) for k in range(12))
            )
        ),
        "its aliases never end",
    ),
    ("no schema", d.at("schema", d.REMOVED), "schema is None"),
    ("a board without ids", d.at("board.type", "circles"), "board.type is 'circles': its marks have no ids"),
    ("a misspelt key", d.text("kinematics:", "kinematic:"), "unknown key kinematic", "kinematics"),
    ("length in mm", d.at("antenna.length_m", 240.0), "antenna.length_m: 240.0 is not between 0.001 and 10"),
    ("a jig in mm", d.at("jig.T_antenna_board.translation_m", [28.0, 61.0, -9.0]), "jig"),
    (
        "a pin that points nowhere",
        d.at("known_object", {"shape": "pin", "position_m": [0, 0, 0], "direction": [0, 0, 0], "std_m": 1e-4}),
        "known_object.direction",
    ),
    ("two sensors", d.at("wrench_sensor", {"components": ["my"], "std_Nm": 2e-5}), "wrench_sensor and moment_sensor"),
    ("a force without its noise", d.at("wrench_sensor", {"components": ["fy"], "std_Nm": 2e-5}), "std_N is missing"),
)
BOARD: tuple[Row, ...] = (
    ("more markers than there are", d.at("squares_x", 40), "markers, DICT_4X4_100 has 100"),
    ("marker larger than square", d.at("marker_m", 0.02), "marker_m is 0.02", "exchanged?"),
    ("no such dictionary", d.at("dictionary", "DICT_9X9_10"), "dictionary is 'DICT_9X9_10'"),
)
WITHOUT_IDS: tuple[Row, ...] = (("markers on a chessboard", d.at("type", "chessboard"), "unknown key"),)
WRONG_BOARD: tuple[Row, ...] = (
    ("another dictionary", d.at("dictionary", "DICT_6X6_250"), "the board spec does not fit", "DICT_4X4"),
)
RIG: tuple[Row, ...] = (
    ("the truth", d.copy("truth.json"), "schema is 'vbaa.truth/1'"),
    ("nested 200 deep", d.at("notes", json.loads(200 * "[" + 200 * "]")), "nested too deeply"),
    ("no schema", d.at("schema", d.REMOVED), "schema is None"),
    ("kilometres", d.at("antenna.length_m", 1e3), "antenna.length_m: 1000.0 is not between 0.001 and 10"),
    ("a diameter of 0.8 m", d.at("antenna.diameter_m", 0.8), "antenna.diameter_m: 0.8 is not between 1e-06 and 0.1"),
    ("a picture of 2^40 columns", d.at("camera.image_size", [2**40, 360]), "camera"),
    ("the antenna behind the camera", d.at("T_antenna_camera.rotation_xyzw", [0, 0, 0, 1]), "in front of the camera"),
    ("a covariance that is not symmetric", d.at("joint.covariance.0.1", 1.0), "joint"),
    ("a parameter that nobody knows", d.at("joint.parameters.0", "colour"), "joint"),
    ("looks of several lengths", d.at("image.looks", [[90, 5]] * 7 + [[90, 80, 70, 5]]), "image.looks"),
)
CAMERA: tuple[Row, ...] = (
    ("a skewed matrix", d.at("matrix.0.1", 3.0), "matrix"),
    ("six coefficients", d.at("distortion", [0.0] * 6), "distortion"),
)
SCENE: tuple[Row, ...] = (
    ("a session", d.copy("session/session.yaml"), "schema"),
    ("a lens that folds back", d.at("camera.distortion", [-5.0, 0, 0, 0]), "camera.distortion", "folds back"),
    ("a picture of a million columns", d.at("camera.image_size", [1_000_000, 360]), "camera.image_size"),
    ("two poses", d.at("camera.T_antenna_camera", {"translation_m": [0, 0, 1], "rotation_xyzw": [1, 0, 0, 0]}), "pose"),
    ("a million pictures", d.at("intrinsics.pictures", 1_000_000), "intrinsics.pictures"),
    ("a load beyond the tip", d.at("loads.0.distance_m", 0.5), "distance_m"),
    ("a billion frames", d.at("recording.sweeps.0.frames", 10**9), "frames"),
)
IMPOSSIBLE: tuple[Row, ...] = (
    ("an object out of reach", d.at("object.center_world_m", [5.0, 0.0, 0.0]), "recording.sweeps", "never meets"),
    ("a load of a lorry", d.at("loads.0.force_y_N", -1e5), "loads", "take a smaller load"),
    ("a sweep over its own back", d.at("recording.sweeps.0.sweep_deg", [-170.0, 170.0]), "recording.sweeps"),
)
TRUTH: tuple[Row, ...] = (
    ("a rig", d.copy("rig.json"), "has no object"),
    (
        "a box without its edge",
        d.several(d.at("object.shape", "box_edge"), d.at("object.wedge_world", None)),
        "object.wedge_world",
    ),
)
NOLOAD: tuple[Row, ...] = (
    ("degrees", d.cell(2, "tilt_rad", "20"), "line 2", "give radians"),
    ("a moment in another unit", d.text("moment_Nm", "moment_mNm"), "column moment_Nm is missing"),
)
LOADS: tuple[Row, ...] = (
    ("a distance in cm", d.cell(2, "distance_m", "10"), "line 2", "the antenna 0.24 m long"),
    ("at the clamp", d.cell(2, "distance_m", "0"), "line 2", "distance_m is 0"),
)
RECORDING: tuple[Row, ...] = (
    ("a frame twice", d.cell(4, "frame", "1"), "line 4", "frame 1 stands"),
    ("time runs backwards", d.cell(4, "time_s", "0.05"), "line 4", "the time runs backwards"),
)
CENTRELINES: tuple[Row, ...] = (
    ("of no frame", d.cell(3, "frame", "9"), "frame 9 is not in recording.csv"),
    ("no deviation", d.cell(3, "sigma_px", "0"), "line 3", "sigma_px is not positive"),
)
CONTACTS: tuple[Row, ...] = (
    ("a frame twice", d.cell(3, "frame", "0"), "line 3", "frame 0 stands already in line 2"),
    ("time runs backwards", d.cell(3, "time_s", "-1"), "line 3", "time_s runs backwards"),
    ("a contact at the clamp", d.cell(3, "distance_m", "0"), "line 3", "distance_m is 0 in a row that is"),
)
OF_ANOTHER: tuple[Row, ...] = (
    ("a frame of another session", d.cell(5, "frame", "99"), "no frame 99", "give the session"),
    ("a joint angle of another session", d.cell(2, "pan_rad", "0.3"), "other joint angles", "give the session"),
    ("a contact of another rig", d.cell(3, "X_m", "0.5"), "do not fit the rig's kinematics"),
    ("no contacts", d.changed(lambda data: data.replace(b",ok,true", b",failed,true")), "no frame has a contact point"),
)
STIFFNESS: tuple[Row, ...] = (
    ("three readings", d.changed(lambda data: b"\n".join(data.split(b"\n")[:4])), "has 3 readings"),
    ("x in mm", d.cell(6, "x_m", "200"), "line 6", "beyond the load"),
    ("against the force", d.changed(lambda data: data.replace(b",0,0.", b",0,-0.")), "run against the force"),
)


def same(data: bytes) -> bytes:
    head, *rows = data.decode().split()
    return "\n".join([head, *(f"{row.split(',')[0]},0,0" for row in rows)]).encode()


POSES: tuple[Row, ...] = (
    ("a view twice", d.cell(3, "view", "board_000.png"), "line 3", "view board_000.png stands twice"),
    (
        "another set's views",
        d.changed(lambda data: data.replace(b"board_", b"frame_")),
        "no row is of one of the views",
    ),
    ("Euler angles", d.text("qx,qy,qz,qw", "a_deg,b_deg,c_deg,d"), "needs their order", "--euler", "ZYX"),
)
CORNERS: tuple[Row, ...] = (
    ("a corner that the board has not", d.cell(3, "id", "4000"), "line 3", "corner 4000, but the board has"),
    ("a corner twice", d.changed(lambda data: data + data.split(b"\n")[1] + b"\n"), "stands twice"),
)
EXCHANGE: dict[str, tuple[Row, ...]] = {
    "ros": (
        ("coefficients of another lens", d.text("1.008031733388]", "1.0, 2.0]"), "a list of 5 or 4 or 0 numbers"),
        ("a skewed matrix", d.text("536.5713701935, 0. , 315", "536.5, 700.0, 315"), "no lens of ours comes near"),
    ),
    "opencv": (("a fisheye of five", d.text("flags: 2", "fisheye_model: 1"), "fisheye_model has 5 coefficients"),),
    "kalibr": (
        ("an unknown camera", d.text("camera_model: pinhole", "camera_model: mei"), "camera_model is 'mei'"),
        ("no rotation", d.text("0.01779318", "0.51779318"), "T_cam_imu is no rigid motion"),
        ("no camera", d.text("cam0:", "camera:"), "holds no camera cam0"),
    ),
    "mrcal": (
        ("a lens of splines", d.text("OPENCV8", "SPLINED_STEREOGRAPHIC"), "lens_model is"),
        ("a call of Python", d.text("1761.181055", "__import__('os')"), "is no mrcal .cameramodel"),
    ),
    "colmap": (("no such camera", d.text("3 SIMPLE", "4 SIMPLE"), "holds no camera 3"),),
    "numbers": (
        ("no size", d.text('"image_size"', '"images"'), "give --size"),
        ("a size turned round", d.text("1280, 960", "960, 1280"), "give --size 1280x960"),
        ("four coefficients", d.text(", 0.01]]", "]]"), "say --no-fisheye or --fisheye"),
    ),
    "orbslam": (("no camera", d.text(".fx", ".f"), "holds no camera"),),
    "cahvor": (("no picture", d.text("1280 960", "0 0"), "Dimensions is 0"),),
}
GUESSED: tuple[Row, ...] = (("the truth", d.copy("truth.json"), "say which with --from"),)
ANSWERS: tuple[Row, ...] = (
    ("misspelt", d.content("antena_length_mm: 240\n"), "antena_length_mm", "do you mean antenna_length_mm?"),
    ("a way that is none", d.content("plane_way: by eye\n"), "plane_way is 'by eye'"),
    ("a load at the clamp", d.content("loads_readings: [{distance_mm: 0}]\n"), "row 1", "distance_m is 0"),
    ("a row with two units", d.content("noload_readings: [{pan_deg: 3, pan_rad: 3}]\n"), "row 1", "give one of them"),
)
ELSEWHERE = {"file": "../a.png", "source": "", "sha256": "", "readings": {}}
WIZARD: tuple[Row, ...] = (
    ("an unknown step", d.at("steps", {"cook": {"taken": [], "left": [], "closed": ""}}), "names a step 'cook'"),
    ("an answer to no question", d.at("answers.colour", "red"), "'colour' is no question"),
    ("a picture outside", d.at("steps", {"lens": {"taken": [ELSEWHERE]}}), "is no file of this session"),
)
CAMERAS = {"kalibr": " --camera-name cam0", "colmap": " --camera-name 3"}
LENS = "intrinsics session/intrinsics --board board.yaml -o o.json"
TRACK, TRUE = "track contacts.csv -o out.csv", "view contacts.csv --truth truth.json --html out.html"
CONVERT = "convert camera.json --to kalibr -o out.yaml"

CASES: list[Case] = [
    *cases("session/session.yaml", CALIBRATE, SESSION),
    *cases("session/session.yaml", ESTIMATE, (("another antenna", d.at("antenna.length_m", 0.26), "the rig's 0.24"),)),
    *cases("board.yaml", LENS, BOARD),
    *(Case(name, "board.yaml", damage, LENS, tuple(words)) for name, damage, *words in WITHOUT_IDS),
    *(Case(name, "board.yaml", what, LENS, ("intrinsics", *words)) for name, what, *words in WRONG_BOARD),
    *cases("rig.json", "budget rig.json -o out.json", RIG),
    *cases("camera.json", CONVERT, CAMERA),
    *cases("scene.yaml", "simulate scene.yaml -o out", SCENE),
    *(
        Case(name, "scene.yaml", what, "simulate scene.yaml -o out", ("scene small", *words))
        for name, what, *words in IMPOSSIBLE
    ),
    *cases("truth.json", TRUE, TRUTH),
    *cases("session/noload/noload.csv", CALIBRATE, NOLOAD),
    *cases("swept/sweep/sweep.csv", CALIBRATE_SWEPT, NOLOAD[:1]),
    *cases("session/loads/loads.csv", CALIBRATE, LOADS),
    *cases("session/loads/loads.csv", CHECK, LOADS[:1]),
    *cases("session/recording/recording.csv", ESTIMATE, RECORDING),
    *cases("lined/recording/centrelines.csv", "estimate lined --rig rig.json -o out.csv", CENTRELINES),
    *cases("poses.csv", HANDEYE, POSES),
    *cases("corners.csv", HANDEYE, CORNERS),
    *cases("stiffness.csv", "stiffness stiffness.csv --load 0.01 --distance 0.2 -o out.json", STIFFNESS),
    *cases("contacts.csv", TRACK, CONTACTS),
    *(Case(name, "contacts.csv", damage, REFINE, tuple(words)) for name, damage, *words in OF_ANOTHER),
    *(
        case
        for name, rows in EXCHANGE.items()
        for case in cases(f"{name}.txt", f"convert {name}.txt --from {name} -o out.json{CAMERAS.get(name, '')}", rows)
    ),
    *cases("ros.txt", "convert ros.txt --to ros -o out.yaml", GUESSED),
    *cases("answers.yaml", "wizard new --answers answers.yaml --batch", ANSWERS),
    *cases("store/wizard.json", "wizard store --batch", WIZARD),
]
