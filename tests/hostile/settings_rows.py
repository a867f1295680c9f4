"""What session.yaml and board.yaml may say that cannot be."""

from __future__ import annotations

from . import damage as d
from .case import Case, Row, cases
from .every_file import CALIBRATE

NAN, ENDLESS = float("nan"), float("inf")

SESSION: tuple[Row, ...] = (
    ("another file", d.copy("truth.json"), "schema is 'vbaa.truth/1'"),
    ("a picture", d.copy("plane/jig_000.png"), "is not UTF-8 text"),
    ("a list", d.content("[1, 2]"), "must be a mapping"),
    ("a number", d.content("3"), "must be a mapping"),
    ("a key twice", d.text("board:", "schema: a\nboard:"), "line", "stands twice"),
    ("a key twice inside", d.text("antenna: {", "antenna: {length_m: 1, "), "line", "'length_m' stands twice"),
    ("a bracket open", d.text("]", ""), "line", "not valid YAML"),
    ("tabs", d.text("  T_antenna", "\tT_antenna"), "line", "not valid YAML"),
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
    ("nested 10000 deep", d.content("schema: " + 10_000 * "["), "nested too deeply"),
    ("a line of 3 MB", d.text("schema:", f"name: {3_000_000 * 'x'}\nschema:"), "holds 3 MB, more than 1 MB"),
    ("no schema", d.at("schema", d.REMOVED), "schema is None"),
    ("the schema of tomorrow", d.at("schema", "vbaa.session/2"), "vbaa.session/1 is needed"),
    ("no board", d.at("board", d.REMOVED), "board is missing"),
    ("board is null", d.at("board", None), "board: None is not a mapping"),
    ("no antenna", d.at("antenna", d.REMOVED), "antenna is missing"),
    ("no sensor", d.at("moment_sensor", d.REMOVED), "moment_sensor is missing"),
    ("no gravity", d.at("gravity_world", d.REMOVED), "gravity_world is missing"),
    ("no jig", d.at("jig", d.REMOVED), "jig is missing"),
    ("a misspelt key", d.text("kinematics:", "kinematic:"), "unknown key kinematic", "kinematics"),
    ("length is text", d.at("antenna.length_m", "24 cm"), "antenna.length_m: '24 cm' is not a number"),
    ("length is a list", d.at("antenna.length_m", [0.24]), "antenna.length_m"),
    ("length is true", d.at("antenna.length_m", True), "antenna.length_m: True is not a number"),
    ("length is null", d.at("antenna.length_m", None), "antenna.length_m: None is not a number"),
    ("length in mm", d.at("antenna.length_m", 240.0), "antenna.length_m: 240.0 is not between 0.001 and 10"),
    ("length is zero", d.at("antenna.length_m", 0.0), "antenna.length_m"),
    ("length is minus zero", d.at("antenna.length_m", -0.0), "antenna.length_m"),
    ("length is negative", d.at("antenna.length_m", -0.24), "antenna.length_m"),
    ("length is NaN", d.at("antenna.length_m", NAN), "antenna.length_m is not a finite number"),
    ("length is endless", d.at("antenna.length_m", ENDLESS), "antenna.length_m is not a finite number"),
    ("length is 1e308", d.at("antenna.length_m", 1e308), "antenna.length_m: 1e+308 is not between"),
    ("length is denormal", d.at("antenna.length_m", 5e-324), "antenna.length_m: 5e-324 is not between"),
    ("length of 5000 digits", d.text("0.24", "9" * 5000), "not valid YAML"),
    ("length of 4000 hexadecimal digits", d.text("0.24", "0x" + "f" * 4000), "antenna.length_m"),
    ("diameter in mm", d.at("antenna.diameter_m", 0.8), "antenna.diameter_m"),
    ("Young's modulus in GPa", d.at("antenna.youngs_modulus_Pa", 193.0), "antenna.youngs_modulus_Pa"),
    ("density in g/cm³", d.at("antenna.density_kg_m3", 7.9), "antenna.density_kg_m3"),
    ("gravity of two numbers", d.at("gravity_world", [0.0, -9.8]), "gravity_world"),
    ("gravity is a number", d.at("gravity_world", 9.8), "gravity_world"),
    ("gravity is NaN", d.at("gravity_world.1", NAN), "gravity_world.1 is not a finite number"),
    ("gravity in g·1000", d.at("gravity_world.2", -9806.65), "gravity_world"),
    ("no noise at all", d.at("moment_sensor.std_Nm", 0.0), "moment_sensor.std_Nm"),
    ("negative noise", d.at("moment_sensor.std_Nm", -1e-5), "moment_sensor.std_Nm"),
    ("noise is text", d.at("moment_sensor.std_Nm", "small"), "moment_sensor.std_Nm"),
    ("a quaternion of zeros", d.at("jig.T_antenna_board.rotation_xyzw", [0, 0, 0, 0]), "rotation_xyzw"),
    ("a quaternion of three", d.at("jig.T_antenna_board.rotation_xyzw", [0, 0, 1]), "rotation_xyzw"),
    ("a quaternion too long", d.at("jig.T_antenna_board.rotation_xyzw", [2, 0, 0, 0]), "rotation_xyzw"),
    ("a jig in mm", d.at("jig.T_antenna_board.translation_m", [28.0, 61.0, -9.0]), "jig"),
    ("a jig's deviation below zero", d.at("jig.translation_std_m", -1.0), "jig.translation_std_m"),
    ("a jig without a pose", d.at("jig", {}), "jig"),
    ("a mount without a turn", d.at("kinematics.T_actuator_antenna", {"translation_m": [0, 0, 0]}), "kinematics"),
    ("joint axes at odds", d.at("kinematics.axis_skew_rad", 20.0), "axis_skew_rad"),
    ("loads known to less than nothing", d.at("load_readings.distance_std_m", -1e-3), "load_readings.distance_std_m"),
    ("print scale of 200 %", d.at("print_scale_std", 2.0), "print_scale_std"),
    ("a second sensor without gain", d.at("second_moment_sensor", {"gain": 0, "offset_Nm": 0, "std_Nm": 1}), "gain"),
)
BOARD: tuple[Row, ...] = (
    ("colour", d.content("colour: red\n"), "unknown key colour"),
    ("squares missing", d.at("squares_x", d.REMOVED), "squares_x is missing"),
    ("squares are text", d.at("squares_x", "eleven"), "squares_x: 'eleven' is not a whole number"),
    ("squares are broken", d.at("squares_x", 11.5), "squares_x: 11.5 is not a whole number"),
    ("one square", d.at("squares_y", 1), "squares_y: 1 is not between 2 and 200"),
    ("a million squares", d.at("squares_x", 1_000_000), "squares_x: 1000000 is not between"),
    ("more markers than there are", d.at("squares_x", 40), "markers, DICT_4X4_100 has 100"),
    ("in mm", d.at("square_m", 15.0), "square_m: 15.0 is not between 0 and 10"),
    ("marker larger than square", d.at("marker_m", 0.02), "marker_m is 0.02", "exchanged?"),
    ("marker as large as the square", d.at("marker_m", 0.015), "0 < marker_m < square_m"),
    ("marker of no size", d.at("marker_m", 0.0), "marker_m: 0.0 is not between"),
    ("NaN", d.at("square_m", NAN), "square_m is not a finite number"),
    ("endless", d.at("square_m", ENDLESS), "square_m is not a finite number"),
    ("a length of two", d.at("square_m", [0.015, 0.015]), "square_m: [0.015, 0.015] is not a number"),
    ("no such dictionary", d.at("dictionary", "DICT_9X9_10"), "dictionary is 'DICT_9X9_10'"),
    ("dictionary is a number", d.at("dictionary", 4), "dictionary: 4 is not a text"),
    ("legacy is a word", d.at("legacy_pattern", "no!"), "legacy_pattern: 'no!' is not true or false"),
    ("a chessboard", d.at("type", "chessboard"), "type: 'chessboard' is not 'charuco'"),
    ("thickness below zero", d.at("thickness_m", -0.001), "thickness_m: -0.001 is not between"),
    ("squares of 5000 digits", d.text("squares_x: 11", "squares_x: " + "9" * 5000), "not valid YAML"),
)
WRONG_BOARD: tuple[Row, ...] = (
    ("another dictionary", d.at("dictionary", "DICT_6X6_250"), "the board spec does not fit", "DICT_4X4"),
    ("another height", d.at("squares_y", 6), "the board spec does not fit", "squares_y is 8 or more"),
)

CASES: list[Case] = [
    *cases("session.yaml", "session/session.yaml", CALIBRATE, SESSION),
    *cases("board.yaml", "board.yaml", "intrinsics session/intrinsics --board board.yaml -o out.json", BOARD),
    *cases("board.yaml", "board.yaml", "board --spec board.yaml -o out.pdf", BOARD),
    *cases("board.yaml", "board.yaml", "selftest --board board.yaml --pictures 1", BOARD),
    *(
        Case(
            name,
            "board.yaml",
            "board.yaml",
            damage,
            "intrinsics session/intrinsics --board board.yaml -o o.json",
            ("intrinsics", *words),
        )
        for name, damage, *words in WRONG_BOARD
    ),
]
