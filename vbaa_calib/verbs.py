"""The verbs of this package: name → (module with `configure` and `run`, one line of help)."""

VERBS = {
    "board": (
        "vbaa_calib.formats.board_cli",
        "a print-exact ChArUco sheet: vector PDF with rulers, SVG, or PNG for a screen",
    ),
    "wizard": ("vbaa_calib.wizard.wizard_cli", "guided, resumable calibration: from a printed board to a trusted rig"),
    "intrinsics": ("vbaa_calib.calibrate.intrinsics_cli", "lens from photos of a ChArUco board"),
    "calibrate": ("vbaa_calib.calibrate.calibrate_cli", "a session to rig.json: lens, plane C, antenna, sensors"),
    "stiffness": ("vbaa_calib.calibrate.stiffness_cli", "EI from a table of measured deflections, no camera needed"),
    "simulate": ("vbaa_calib.synth.simulate_cli", "a synthetic session from a scene file, with truth.json"),
    "selftest": ("vbaa_calib.bench.selftest_cli", "draw your board with known corners: how far off is this OpenCV?"),
    "bench": ("vbaa_calib.bench.bench_cli", "speed against error, with the alternatives in the same run"),
    "convert": ("vbaa_calib.formats.convert_cli", "the camera to and from ROS, OpenCV, Kalibr, mrcal and COLMAP files"),
    "schema": ("vbaa_calib.formats.schema_cli", "print the JSON Schema of session.yaml or rig.json"),
}
