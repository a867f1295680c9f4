"""What other programs' camera files, answers and the wizard's memory may hold that cannot be."""

from __future__ import annotations

from . import damage as d
from .case import Case, Row, cases
from .settings_rows import NAN

EXCHANGE: dict[str, tuple[Row, ...]] = {
    "ros": (
        ("a picture of half a pixel", d.text("image_width: 640", "image_width: 640.5"), "image_width is 640.5"),
        ("an unknown lens", d.text("plumb_bob", "thin_prism_fisheye"), "distortion_model is 'thin_prism_fisheye'"),
        ("coefficients of another lens", d.text("1.008031733388]", "1.0, 2.0]"), "a list of 5 or 4 or 0 numbers"),
        ("NaN", d.text("536.5713701935, 0. , 315", ".nan, 0. , 315"), "camera_matrix.data holds nan"),
        ("a key twice", d.text("image_height", "image_width"), "stands twice"),
        ("no matrix", d.text("camera_matrix:", "camera_matrix2:"), "camera_matrix is missing"),
        ("a skewed matrix", d.text("536.5713701935, 0. , 315", "536.5, 700.0, 315"), "no lens of ours comes near"),
    ),
    "opencv": (
        ("a type that is none", d.text("dt: d", "dt: q"), "OpenCV cannot read it"),
        ("no matrix", d.text("camera_matrix", "camera_mat"), "camera_matrix is missing"),
        ("a width of text", d.text("image_width: 640", "image_width: abc"), "image_width is None"),
        ("a fisheye of five", d.text("flags: 2", "fisheye_model: 1"), "fisheye_model has 5 coefficients"),
        ("nested 10000 deep", d.content("%YAML:1.0\n---\na: " + 10_000 * "["), "OpenCV cannot read it"),
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
        ("nested 10000 deep", d.content(10_000 * "["), "is no mrcal .cameramodel"),
        ("a camera at 1e200 m", d.text("-1e-2,  1.,", "-1e-2,  1e200,"), "extrinsics"),
    ),
    "colmap": (
        ("an unknown lens", d.text("SIMPLE_RADIAL", "DIVISION"), "the model is 'DIVISION'"),
        ("NaN", d.text("2559.69", "nan"), "'nan' is no number"),
        ("half a pixel", d.text("3 SIMPLE_RADIAL 3072", "3 SIMPLE_RADIAL 3072.5"), "the picture's side is 3072.5"),
        ("no such camera", d.text("3 SIMPLE", "4 SIMPLE"), "holds no camera 3"),
    ),
    "numbers": (
        ("no size", d.text('"image_size"', '"images"'), "give --size"),
        ("a size turned round", d.text("1280, 960", "960, 1280"), "give --size 1280x960"),
        ("four coefficients", d.text(", 0.01]]", "]]"), "say --no-fisheye or --fisheye"),
        ("a row too short", d.text("[0.0, 0.0, 1.0]", "[0.0, 1.0]"), "camera_matrix is missing or no matrix"),
        ("no coefficients", d.text('"dist"', '"rms"'), "distortion_coefficients is missing"),
    ),
    "orbslam": (
        ("an unknown lens", d.text("PinHole", "Omni"), "Camera.type is 'Omni'"),
        ("a focal length of words", d.text("fy: 457.296", "fy: long"), "Camera1.fy is long"),
        ("half a pixel", d.text("752", "752.5"), "Camera.width is 752.5"),
        ("no camera", d.text(".fx", ".f"), "holds no camera"),
    ),
    "cahvor": (
        ("no axis", d.text("A = 0.0 0.0 1.0", "A = 0.0 0.0 0.0"), "are no directions"),
        ("a vector of two", d.text("H = 900.0 0.0 639.5", "H = 900.0 0.0"), "H is"),
        ("no picture", d.text("1280 960", "0 0"), "Dimensions is 0"),
    ),
}
GUESSED: tuple[Row, ...] = (
    ("nothing but a comment", d.content("# nothing\n"), "say which with --from"),
    ("the truth", d.copy("truth.json"), "say which with --from"),
    ("a table", d.copy("contacts.csv"), "say which with --from"),
)
ANSWERS: tuple[Row, ...] = (
    ("misspelt", d.content("antena_length_mm: 240\n"), "antena_length_mm", "do you mean antenna_length_mm?"),
    ("another unit", d.content("antenna_length_m: 0.24\n"), "antenna_length_mm?"),
    ("a key twice", d.content("plane_way: jig\nplane_way: jig\n"), "line 2", "stands twice"),
    ("a list", d.content("- board\n"), "must be a mapping"),
    ("with another unit", d.content("antenna_length_mm: 240 kg\n"), "antenna_length_mm"),
    ("a length of 5000 digits", d.content("antenna_length_mm: " + 5000 * "9"), "antenna_length_mm"),
    ("a way that is none", d.content("plane_way: by eye\n"), "plane_way is 'by eye'"),
    ("a row that is a number", d.content("noload_readings: [1, 2]\n"), "row 1", "is not a mapping", "pan_rad"),
    ("a row with an unknown key", d.content("noload_readings: [{pan: 3}]\n"), "row 1", "unknown key 'pan'", "pan_deg"),
    ("a load at the clamp", d.content("loads_readings: [{distance_mm: 0}]\n"), "row 1", "distance_m is 0"),
    ("a picture twice", d.content("noload_readings: [{image: a.png}, {image: a.png}]\n"), "row 2", "stands twice"),
    ("a picture of a number", d.content("noload_readings: [{image: 12}]\n"), "row 1", "image is no name"),
    ("a row with text", d.content("noload_readings: [{}, {pan_deg: 3°}]\n"), "row 2", "pan_deg is '3°'"),
    ("a row with two units", d.content("noload_readings: [{pan_deg: 3, pan_rad: 3}]\n"), "row 1", "give one of them"),
)
ELSEWHERE = {"file": "../a.png", "source": "", "sha256": "", "readings": {}}
WIZARD: tuple[Row, ...] = (
    ("cut short", d.cut(0.6), "is not valid JSON", "move wizard.json away"),
    ("a length of 400 digits", d.text("240.0", str(10**400)), "is damaged"),
    ("another schema", d.at("schema", "vbaa.wizard/9"), "vbaa.wizard/1 is needed"),
    ("no steps", d.at("steps", d.REMOVED), "is damaged"),
    ("an unknown step", d.at("steps", {"cook": {"taken": [], "left": [], "closed": ""}}), "names a step 'cook'"),
    ("an answer of NaN", d.at("answers.antenna_length_mm", NAN), "not a finite number"),
    ("an answer to no question", d.at("answers.colour", "red"), "'colour' is no question"),
    ("a picture outside", d.at("steps", {"lens": {"taken": [ELSEWHERE]}}), "is no file of this session"),
)
CAMERAS = {"kalibr": " --camera-name cam0", "colmap": " --camera-name 3"}

CASES: list[Case] = [
    *(
        case
        for name, rows in EXCHANGE.items()
        for case in cases(
            name, f"{name}.txt", f"convert {name}.txt --from {name} -o out.json{CAMERAS.get(name, '')}", rows
        )
    ),
    *(
        case
        for name in EXCHANGE
        for case in cases(name, f"{name}.txt", f"convert {name}.txt --to ros -o out.yaml", GUESSED)
    ),
    *cases("answers.yaml", "answers.yaml", "wizard new --answers answers.yaml --batch", ANSWERS),
    *cases("wizard.json", "store/wizard.json", "wizard store --batch", WIZARD),
]
