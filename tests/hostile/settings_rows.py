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
    ("a key twice", d.text("board:", "schema: a\nboard:"), "line", "stands twice"),
    ("a bracket open", d.text("]", ""), "line", "not valid YAML"),
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
    ("a board without ids", d.at("board.type", "circles"), "board.type is 'circles': its marks have no ids"),
    ("no jig", d.at("jig", d.REMOVED), "jig is missing"),
    ("a misspelt key", d.text("kinematics:", "kinematic:"), "unknown key kinematic", "kinematics"),
    ("length is text", d.at("antenna.length_m", "24 cm"), "antenna.length_m: '24 cm' is not a number"),
    ("length in mm", d.at("antenna.length_m", 240.0), "antenna.length_m: 240.0 is not between 0.001 and 10"),
    ("length is NaN", d.at("antenna.length_m", NAN), "antenna.length_m is not a finite number"),
    ("length of 5000 digits", d.text("0.24", "9" * 5000), "antenna.length_m"),
    ("length of 4000 hexadecimal digits", d.text("0.24", "0x" + "f" * 4000), "antenna.length_m"),
    ("a length in sixtieths", d.text("0.24", "1" + 100_000 * ":30"), "antenna.length_m"),
    ("gravity of two numbers", d.at("gravity_world", [0.0, -9.8]), "gravity_world"),
    ("gravity in g", d.at("gravity_world", [0.0, 0.0, -1.0]), "gravity_world has the size 1", "m/s²"),
    ("900000 digits", d.text("0.24", "9" * 900_000), "antenna.length_m"),
    ("sixties of sixties", d.text("0.24", "1" + ":1" * 140_000), "antenna.length_m"),
    ("a tagged number without end", d.text("0.24", "!!int 1" + ":1" * 140_000), "is not valid YAML"),
    ("gravity is NaN", d.at("gravity_world.1", NAN), "gravity_world.1 is not a finite number"),
    ("no noise at all", d.at("moment_sensor.std_Nm", 0.0), "moment_sensor.std_Nm"),
    ("a quaternion of zeros", d.at("jig.T_antenna_board.rotation_xyzw", [0, 0, 0, 0]), "rotation_xyzw"),
    ("a jig in mm", d.at("jig.T_antenna_board.translation_m", [28.0, 61.0, -9.0]), "jig"),
    ("a jig without a pose", d.at("jig", {}), "jig"),
    ("a position in millimetres", d.at("kinematics.position_world_m", [0, 0, 120]), "kinematics.position_world_m"),
    ("a mount without a turn", d.at("kinematics.T_actuator_antenna", {"translation_m": [0, 0, 0]}), "kinematics"),
    ("print scale of 200 %", d.at("print_scale_std", 2.0), "print_scale_std"),
    ("a known object of no shape", d.at("known_object", {"shape": "cup"}), "known_object"),
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
    ("no such component", d.at("wrench_sensor", {"components": ["my", "tz"], "std_Nm": 2e-5}), "wrench_sensor"),
    ("one component twice", d.at("wrench_sensor", {"components": ["my", "-my"], "std_Nm": 2e-5}), "twice"),
    ("none at all", d.at("wrench_sensor", {"components": [], "std_Nm": 2e-5}), "components of wrench_sensor are none"),
)
BOARD: tuple[Row, ...] = (
    ("colour", d.content("colour: red\n"), "unknown key colour"),
    ("squares missing", d.at("squares_x", d.REMOVED), "squares_x is missing"),
    ("squares are broken", d.at("squares_x", 11.5), "squares_x: 11.5 is not a whole number"),
    ("more markers than there are", d.at("squares_x", 40), "markers, DICT_4X4_100 has 100"),
    ("in mm", d.at("square_m", 15.0), "square_m: 15.0 is not between 0 and 10"),
    ("marker larger than square", d.at("marker_m", 0.02), "marker_m is 0.02", "exchanged?"),
    ("NaN", d.at("square_m", NAN), "square_m is not a finite number"),
    ("no such dictionary", d.at("dictionary", "DICT_9X9_10"), "dictionary is 'DICT_9X9_10'"),
    ("legacy is a word", d.at("legacy_pattern", "no!"), "legacy_pattern: 'no!' is not true or false"),
    ("another kind of board", d.at("type", "rings"), "type"),
    ("squares of 5000 digits", d.text("squares_x: 11", "squares_x: " + "9" * 5000), "squares_x"),
)
_LENS = "intrinsics session/intrinsics --board board.yaml -o out.json"
WITHOUT_IDS: tuple[Row, ...] = (
    ("markers on a chessboard", d.at("type", "chessboard"), "unknown key"),
    ("a type that is a list", d.at("type", ["circles"]), "type is ['circles']"),
    (
        "squares of circles",
        d.content("{type: circles, squares_x: 9, rows: 6, spacing_m: 0.02}"),
        "unknown key squares_x",
    ),
    ("no spacing", d.content("{type: circles, columns: 9, rows: 6}"), "spacing_m is missing"),
    (
        "two rows",
        d.content("{type: circles, columns: 9, rows: 2, spacing_m: 0.02}"),
        "rows: 2 is not between 3 and 50",
    ),
    ("of NaN", d.content("{type: chessboard, squares_x: 9, squares_y: 6, square_m: .nan}"), "square_m is not a finite"),
    (
        "not on the pictures",
        d.content("{type: chessboard, squares_x: 9, squares_y: 6, square_m: 0.02}"),
        "the board spec does not fit the pictures: a ChArUco board is in the pictures",
    ),
)
WRONG_BOARD: tuple[Row, ...] = (
    ("another dictionary", d.at("dictionary", "DICT_6X6_250"), "the board spec does not fit", "DICT_4X4"),
    ("another height", d.at("squares_y", 6), "the board spec does not fit", "squares_y is 8 or more"),
)

CASES: list[Case] = [
    *cases("session.yaml", "session/session.yaml", CALIBRATE, SESSION),
    *cases("board.yaml", "board.yaml", _LENS, BOARD),
    *(Case(name, "board.yaml", "board.yaml", damage, _LENS, tuple(words)) for name, damage, *words in WITHOUT_IDS),
    *cases("board.yaml", "board.yaml", "board --spec board.yaml -o out.pdf", BOARD),
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
