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
    ("a Python object", d.text("0.24", "!!python/object/apply:os.getcwd []"), "not valid YAML"),
    ("an alias of itself", d.text("gravity_world: [", "gravity_world: &a [*a, "), "its aliases never end"),
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
    ("a line of 3 MB", d.text("schema:", f"name: {3_000_000 * 'x'}\nschema:"), "holds 3 MB, more than 1 MB"),
    ("no schema", d.at("schema", d.REMOVED), "schema is None"),
    ("the schema of tomorrow", d.at("schema", "vbaa.session/2"), "vbaa.session/1 is needed"),
    ("a board without ids", d.at("board.type", "circles"), "board.type is 'circles': its marks have no ids"),
    ("no jig", d.at("jig", d.REMOVED), "jig is missing"),
    ("a misspelt key", d.text("kinematics:", "kinematic:"), "unknown key kinematic", "kinematics"),
    ("length in mm", d.at("antenna.length_m", 240.0), "antenna.length_m: 240.0 is not between 0.001 and 10"),
    ("a length in sixtieths", d.text("0.24", "1" + 100_000 * ":30"), "antenna.length_m"),
    ("gravity of two numbers", d.at("gravity_world", [0.0, -9.8]), "gravity_world"),
    ("gravity in g", d.at("gravity_world", [0.0, 0.0, -1.0]), "gravity_world has the size 1", "m/s²"),
    ("no noise at all", d.at("moment_sensor.std_Nm", 0.0), "moment_sensor.std_Nm"),
    ("a quaternion of zeros", d.at("jig.T_antenna_board.rotation_xyzw", [0, 0, 0, 0]), "rotation_xyzw"),
    ("a jig in mm", d.at("jig.T_antenna_board.translation_m", [28.0, 61.0, -9.0]), "jig"),
    ("a position in millimetres", d.at("kinematics.position_world_m", [0, 0, 120]), "kinematics.position_world_m"),
    ("print scale of 200 %", d.at("print_scale_std", 2.0), "print_scale_std"),
    (
        "a pin that points nowhere",
        d.at("known_object", {"shape": "pin", "position_m": [0, 0, 0], "direction": [0, 0, 0], "std_m": 1e-4}),
        "known_object.direction",
    ),
    (
        "a pin whose place is known exactly",
        d.at("known_object", {"shape": "pin", "position_m": [0, 0, 0], "direction": [0, 0, 1], "std_m": 0}),
        "known_object.std_m",
    ),
    ("a second sensor without gain", d.at("second_moment_sensor", {"gain": 0, "offset_Nm": 0, "std_Nm": 1}), "gain"),
    ("two sensors", d.at("wrench_sensor", {"components": ["my"], "std_Nm": 2e-5}), "wrench_sensor and moment_sensor"),
    ("a force without its noise", d.at("wrench_sensor", {"components": ["fy"], "std_Nm": 2e-5}), "std_N is missing"),
    ("one component twice", d.at("wrench_sensor", {"components": ["my", "-my"], "std_Nm": 2e-5}), "twice"),
    ("none at all", d.at("wrench_sensor", {"components": [], "std_Nm": 2e-5}), "components of wrench_sensor are none"),
)
BOARD: tuple[Row, ...] = (
    ("squares missing", d.at("squares_x", d.REMOVED), "squares_x is missing"),
    ("more markers than there are", d.at("squares_x", 40), "markers, DICT_4X4_100 has 100"),
    ("in mm", d.at("square_m", 15.0), "square_m: 15.0 is not between 0 and 10"),
    ("marker larger than square", d.at("marker_m", 0.02), "marker_m is 0.02", "exchanged?"),
    ("no such dictionary", d.at("dictionary", "DICT_9X9_10"), "dictionary is 'DICT_9X9_10'"),
    ("legacy is a word", d.at("legacy_pattern", "no!"), "legacy_pattern: 'no!' is not true or false"),
)
WITHOUT_IDS: tuple[Row, ...] = (
    ("markers on a chessboard", d.at("type", "chessboard"), "unknown key"),
    (
        "squares of circles",
        d.content("{type: circles, squares_x: 9, rows: 6, spacing_m: 0.02}"),
        "unknown key squares_x",
    ),
    ("two rows", d.content("{type: circles, columns: 9, rows: 2, spacing_m: 0.02}"), "rows: 2 is not between 3 and 50"),
)
WRONG_BOARD: tuple[Row, ...] = (
    ("another dictionary", d.at("dictionary", "DICT_6X6_250"), "the board spec does not fit", "DICT_4X4"),
    ("another height", d.at("squares_y", 6), "the board spec does not fit", "squares_y is 8 or more"),
)
RIG: tuple[Row, ...] = (
    ("the truth", d.copy("truth.json"), "schema is 'vbaa.truth/1'"),
    ("a lens alone", d.copy("camera.json"), "schema is 'vbaa.camera/1'"),
    ("nested 200 deep", d.at("notes", json.loads(200 * "[" + 200 * "]")), "nested too deeply"),
    ("gravity in g", d.at("gravity_world", [0.0, 0.0, -1.0]), "gravity_world has the size 1", "m/s²"),
    ("no schema", d.at("schema", d.REMOVED), "schema is None"),
    ("no covariance", d.at("joint", d.REMOVED), "joint"),
    ("kilometres", d.at("antenna.length_m", 1e3), "antenna.length_m: 1000.0 is not between 0.001 and 10"),
    ("a diameter of 0.8 m", d.at("antenna.diameter_m", 0.8), "antenna.diameter_m: 0.8 is not between 1e-06 and 0.1"),
    ("a bow of a nanometre's radius", d.at("antenna.noload.bow_yz_per_m.1", 1e9), "antenna.noload.bow_yz_per_m.1"),
    ("no gain", d.at("moment_sensor.gain", 0), "moment_sensor.gain: 0 is not between"),
    ("three coefficients", d.at("camera.distortion", [0.1, 0.1, 0.1]), "camera"),
    ("a lens that is none", d.at("camera.model", "pinhole"), "camera"),
    ("a picture of 2^40 columns", d.at("camera.image_size", [2**40, 360]), "camera"),
    ("a quaternion of zeros", d.at("T_antenna_camera.rotation_xyzw", [0, 0, 0, 0]), "T_antenna_camera"),
    ("the antenna behind the camera", d.at("T_antenna_camera.rotation_xyzw", [0, 0, 0, 1]), "in front of the camera"),
    ("the camera 1e300 m away", d.at("T_antenna_camera.translation_m", [1e300, 0, 0]), "T_antenna_camera"),
    ("a covariance that is not symmetric", d.at("joint.covariance.0.1", 1.0), "joint"),
    ("a covariance below zero", d.at("joint.covariance.0.0", -1.0), "joint"),
    ("a parameter that nobody knows", d.at("joint.parameters.0", "colour"), "joint"),
    ("weights of two colours", d.at("image.weights_bgr", [1, 1]), "image.weights_bgr"),
    ("looks of several lengths", d.at("image.looks", [[90, 5]] * 7 + [[90, 80, 70, 5]]), "image.looks"),
    ("an axes' deviation of two", d.at("kinematics.axes_uncertainty.std", [0, 0]), "kinematics.axes_uncertainty"),
)
CAMERA: tuple[Row, ...] = (
    ("the schema of tomorrow", d.at("schema", "vbaa.camera/2"), "looks like none"),
    ("a skewed matrix", d.at("matrix.0.1", 3.0), "matrix"),
    ("a size of three", d.at("image_size", [480, 360, 3]), "image_size"),
    ("six coefficients", d.at("distortion", [0.0] * 6), "distortion"),
)
SCENE: tuple[Row, ...] = (
    ("a session", d.copy("session/session.yaml"), "schema"),
    ("an unknown key", d.at("colour", "red"), "colour"),
    ("no sweeps", d.at("recording.sweeps", []), "sweeps"),
    ("a lens that folds back", d.at("camera.distortion", [-5.0, 0, 0, 0]), "camera.distortion", "folds back"),
    ("a picture of a million columns", d.at("camera.image_size", [1_000_000, 360]), "camera.image_size"),
    ("two poses", d.at("camera.T_antenna_camera", {"translation_m": [0, 0, 1], "rotation_xyzw": [1, 0, 0, 0]}), "pose"),
    ("the camera lies in plane C", d.at("camera.pose.inclination_deg", 90.0), "inclination_deg"),
    ("a shape that is none", d.at("object.shape", "cow"), "object.shape"),
    ("friction below zero", d.at("object.friction", -0.1), "object.friction"),
    ("bumps on a cylinder", d.at("object.bumps", []), "object.bumps"),
    ("a million pictures", d.at("intrinsics.pictures", 1_000_000), "intrinsics.pictures"),
    ("a load beyond the tip", d.at("loads.0.distance_m", 0.5), "distance_m"),
    ("a billion frames", d.at("recording.sweeps.0.frames", 10**9), "frames"),
)
IMPOSSIBLE: tuple[Row, ...] = (
    ("an object out of reach", d.at("object.center_world_m", [5.0, 0.0, 0.0]), "recording.sweeps", "never meets"),
    ("an object around the clamp", d.at("object.radius_m", 0.5), "recording.sweeps"),
    ("a load of a lorry", d.at("loads.0.force_y_N", -1e5), "loads", "take a smaller load"),
    ("a sweep over its own back", d.at("recording.sweeps.0.sweep_deg", [-170.0, 170.0]), "recording.sweeps"),
)
TRUTH: tuple[Row, ...] = (
    ("a rig", d.copy("rig.json"), "has no object"),
    ("a shape that is none", d.at("object.shape", "cow"), "object.shape: 'cow' is not"),
    ("a radius below zero", d.at("object.radius_m", -1.0), "object.radius_m"),
    (
        "a box without its edge",
        d.several(d.at("object.shape", "box_edge"), d.at("object.wedge_world", None)),
        "object.wedge_world",
    ),
)
MESH: tuple[Row, ...] = (
    (
        "points of another number",
        d.changed(lambda data: data.replace(b'NumberOfPoints="', b'NumberOfPoints="9')),
        "mesh",
    ),
    ("no points", d.content('<VTKFile type="PolyData"><PolyData/></VTKFile>'), "holds no mesh"),
)
PLY: tuple[Row, ...] = (
    (
        "2^60 points",
        d.changed(lambda data: data.replace(b"element vertex ", b"element vertex 999999999999")),
        "no mesh",
    ),
    (
        "a type that is none",
        d.changed(lambda data: data.replace(b"property double x", b"property colour x")),
        "no mesh",
    ),
)
GLB: tuple[Row, ...] = (
    ("a version of tomorrow", d.changed(lambda data: data[:4] + b"\x09\0\0\0" + data[8:]), "holds no mesh"),
    ("a length that is wrong", d.changed(lambda data: data[:8] + b"\xff\xff\xff\x7f" + data[12:]), "holds no mesh"),
)
NOLOAD: tuple[Row, ...] = (
    ("degrees", d.cell(2, "tilt_rad", "20"), "line 2", "give radians"),
    ("a picture twice", d.cell(3, "image", "noload_000.png"), "line 3", "stands in line 2, too"),
    ("no picture named", d.cell(2, "image", ""), "line 2", "image is empty"),
    ("a moment in another unit", d.text("moment_Nm", "moment_mNm"), "column moment_Nm is missing"),
)
LOADS: tuple[Row, ...] = (
    ("a distance in cm", d.cell(2, "distance_m", "10"), "line 2", "the antenna 0.24 m long"),
    ("at the clamp", d.cell(2, "distance_m", "0"), "line 2", "distance_m is 0"),
    ("no force", d.cell(2, "force_y_N", "0"), "line 2", "the force is zero"),
)
RECORDING: tuple[Row, ...] = (
    ("a frame twice", d.cell(4, "frame", "1"), "line 4", "frame 1 stands"),
    ("time runs backwards", d.cell(4, "time_s", "0.05"), "line 4", "the time runs backwards"),
    ("degrees", d.cell(3, "pan_rad", "-90"), "line 3", "give radians"),
    ("a moment under another name", d.text("moment_Nm", "moment_mNm"), "but there is moment_mNm"),
)
CENTRELINES: tuple[Row, ...] = (
    ("of no frame", d.cell(3, "frame", "9"), "frame 9 is not in recording.csv"),
    ("no deviation", d.cell(3, "sigma_px", "0"), "line 3", "sigma_px is not positive"),
)
CONTACTS: tuple[Row, ...] = (
    ("a frame twice", d.cell(3, "frame", "0"), "line 3", "frame 0 stands already in line 2"),
    ("time runs backwards", d.cell(3, "time_s", "-1"), "line 3", "time_s runs backwards"),
    ("a status that is none", d.cell(3, "status", "fine"), "line 3", "status"),
    ("a contact at the clamp", d.cell(3, "distance_m", "0"), "line 3", "distance_m is 0 in a row that is"),
    ("a covariance below zero", d.cell(3, "cov_XX", "-1e-6"), "line 3", "cov"),
    ("a covariance that is none", d.cell(3, "cov_XY", "1"), "line 3", "cov"),
)
OF_ANOTHER: tuple[Row, ...] = (
    ("a frame of another session", d.cell(5, "frame", "99"), "no frame 99", "give the session"),
    ("a time of another session", d.cell(5, "time_s", "1000"), "has another time", "give the session"),
    ("a joint angle of another session", d.cell(2, "pan_rad", "0.3"), "other joint angles", "give the session"),
    ("a contact of another rig", d.cell(3, "X_m", "0.5"), "do not fit the rig's kinematics"),
    ("no contacts", d.changed(lambda data: data.replace(b",ok,true", b",failed,true")), "no frame has a contact point"),
)
STIFFNESS: tuple[Row, ...] = (
    ("three readings", d.changed(lambda data: b"\n".join(data.split(b"\n")[:4])), "has 3 readings"),
    ("in mm", d.cell(6, "loaded_y_m", "6.6"), "deflected by 6.6 m"),
    ("x in mm", d.cell(6, "x_m", "200"), "line 6", "beyond the load"),
    ("x twice", d.cell(3, "x_m", "0.04"), "line 3", "a second time"),
    ("no deflection", d.changed(lambda data: same(data)), "equals unloaded_y_m"),
    ("against the force", d.changed(lambda data: data.replace(b",0,0.", b",0,-0.")), "run against the force"),
)


def same(data: bytes) -> bytes:
    head, *rows = data.decode().split()
    return "\n".join([head, *(f"{row.split(',')[0]},0,0" for row in rows)]).encode()


POSES: tuple[Row, ...] = (
    ("a view twice", d.cell(3, "view", "board_000.png"), "line 3", "view board_000.png stands twice"),
    ("a view twice, once without its suffix", d.cell(3, "view", "board_000"), "view board_000.png stands twice"),
    (
        "views of another set",
        d.changed(lambda data: data.replace(b"board_", b"frame_")),
        "no row is of one of the views",
    ),
    ("half a quaternion", d.cell(2, "qx", "9"), "line 2", "the quaternion's length is"),
    ("Euler angles", d.text("qx,qy,qz,qw", "a_deg,b_deg,c_deg,d"), "needs their order", "--euler", "ZYX"),
)
CORNERS: tuple[Row, ...] = (
    ("a corner that the board has not", d.cell(3, "id", "4000"), "line 3", "corner 4000, but the board has"),
    ("a corner twice", d.changed(lambda data: data + data.split(b"\n")[1] + b"\n"), "stands twice"),
    ("a corner outside", d.cell(3, "u_px", "1e6"), "line 3", "outside the picture"),
    ("one corner", d.changed(lambda data: b"\n".join(data.split(b"\n")[:2])), "0 of 1 views can be used"),
)
EXCHANGE: dict[str, tuple[Row, ...]] = {
    "ros": (
        ("an unknown lens", d.text("plumb_bob", "thin_prism_fisheye"), "distortion_model is 'thin_prism_fisheye'"),
        ("coefficients of another lens", d.text("1.008031733388]", "1.0, 2.0]"), "a list of 5 or 4 or 0 numbers"),
        ("a key twice", d.text("image_height", "image_width"), "stands twice"),
        ("a skewed matrix", d.text("536.5713701935, 0. , 315", "536.5, 700.0, 315"), "no lens of ours comes near"),
    ),
    "opencv": (
        ("a type that is none", d.text("dt: d", "dt: q"), "OpenCV cannot read it"),
        ("no matrix", d.text("camera_matrix", "camera_mat"), "camera_matrix is missing"),
        ("a fisheye of five", d.text("flags: 2", "fisheye_model: 1"), "fisheye_model has 5 coefficients"),
    ),
    "kalibr": (
        ("an unknown camera", d.text("camera_model: pinhole", "camera_model: mei"), "camera_model is 'mei'"),
        ("an unknown lens", d.text("radtan", "atan"), "distortion_model is 'atan'"),
        ("no rotation", d.text("0.01779318", "0.51779318"), "T_cam_imu is no rigid motion"),
        ("no camera", d.text("cam0:", "camera:"), "holds no camera cam0"),
    ),
    "mrcal": (
        ("a lens of splines", d.text("OPENCV8", "SPLINED_STEREOGRAPHIC"), "lens_model is"),
        ("a call of Python", d.text("1761.181055", "__import__('os')"), "is no mrcal .cameramodel"),
    ),
    "colmap": (
        ("an unknown lens", d.text("SIMPLE_RADIAL", "DIVISION"), "the model is 'DIVISION'"),
        ("half a pixel", d.text("3 SIMPLE_RADIAL 3072", "3 SIMPLE_RADIAL 3072.5"), "the picture's side is 3072.5"),
        ("no such camera", d.text("3 SIMPLE", "4 SIMPLE"), "holds no camera 3"),
    ),
    "numbers": (
        ("no size", d.text('"image_size"', '"images"'), "give --size"),
        ("a size turned round", d.text("1280, 960", "960, 1280"), "give --size 1280x960"),
        ("four coefficients", d.text(", 0.01]]", "]]"), "say --no-fisheye or --fisheye"),
    ),
    "orbslam": (
        ("an unknown lens", d.text("PinHole", "Omni"), "Camera.type is 'Omni'"),
        ("no camera", d.text(".fx", ".f"), "holds no camera"),
    ),
    "cahvor": (
        ("no axis", d.text("A = 0.0 0.0 1.0", "A = 0.0 0.0 0.0"), "are no directions"),
        ("no picture", d.text("1280 960", "0 0"), "Dimensions is 0"),
    ),
}
GUESSED: tuple[Row, ...] = (
    ("the truth", d.copy("truth.json"), "say which with --from"),
    ("a table", d.copy("contacts.csv"), "say which with --from"),
)
ANSWERS: tuple[Row, ...] = (
    ("misspelt", d.content("antena_length_mm: 240\n"), "antena_length_mm", "do you mean antenna_length_mm?"),
    ("another unit", d.content("antenna_length_m: 0.24\n"), "antenna_length_mm?"),
    ("a way that is none", d.content("plane_way: by eye\n"), "plane_way is 'by eye'"),
    ("a row that is a number", d.content("noload_readings: [1, 2]\n"), "row 1", "is not a mapping", "pan_rad"),
    ("a row with an unknown key", d.content("noload_readings: [{pan: 3}]\n"), "row 1", "unknown key 'pan'", "pan_deg"),
    ("a load at the clamp", d.content("loads_readings: [{distance_mm: 0}]\n"), "row 1", "distance_m is 0"),
    ("a picture twice", d.content("noload_readings: [{image: a.png}, {image: a.png}]\n"), "row 2", "stands twice"),
    ("a row with text", d.content("noload_readings: [{}, {pan_deg: 3°}]\n"), "row 2", "pan_deg is '3°'"),
    ("a row with two units", d.content("noload_readings: [{pan_deg: 3, pan_rad: 3}]\n"), "row 1", "give one of them"),
)
ELSEWHERE = {"file": "../a.png", "source": "", "sha256": "", "readings": {}}
WIZARD: tuple[Row, ...] = (
    ("another schema", d.at("schema", "vbaa.wizard/9"), "vbaa.wizard/1 is needed"),
    ("an unknown step", d.at("steps", {"cook": {"taken": [], "left": [], "closed": ""}}), "names a step 'cook'"),
    ("an answer to no question", d.at("answers.colour", "red"), "'colour' is no question"),
    ("a picture outside", d.at("steps", {"lens": {"taken": [ELSEWHERE]}}), "is no file of this session"),
)
CAMERAS = {"kalibr": " --camera-name cam0", "colmap": " --camera-name 3"}
LENS = "intrinsics session/intrinsics --board board.yaml -o o.json"
TRACK, TRUE = "track contacts.csv -o out.csv", "view contacts.csv --truth truth.json --html out.html"
SHOW, CONVERT = "view contacts.csv --object object", "convert camera.json --to kalibr -o out.yaml"

CASES: list[Case] = [
    *cases("session/session.yaml", CALIBRATE, SESSION),
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
    *cases("object.vtp", f"{SHOW}.vtp --html out.html", MESH),
    *cases("object.ply", f"{SHOW}.ply --html out.html", PLY),
    *cases("object.glb", f"{SHOW}.glb --html out.html", GLB),
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
