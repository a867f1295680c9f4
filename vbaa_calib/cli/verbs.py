"""The verbs of this package: name → (module with `configure` and `run`, one line of help)."""

VERBS = {
    "board": (
        "vbaa_calib.cli.board",
        "a print-exact ChArUco sheet: vector PDF with rulers, SVG, or PNG for a screen",
    ),
    "wizard": ("viz.cli.wizard", "guided, resumable calibration: from a printed board to a trusted rig"),
    "intrinsics": ("vbaa_calib.cli.intrinsics", "lens from photos of a ChArUco board"),
    "calibrate": ("vbaa_calib.cli.calibrate", "a session to rig.json: lens, plane C, antenna, sensors"),
    "stiffness": ("vbaa_calib.cli.stiffness", "EI from a table of measured deflections, no camera needed"),
    "simulate": ("vbaa_calib.cli.simulate", "a synthetic session from a scene file, with truth.json"),
    "selftest": ("vbaa_calib.cli.selftest", "draw your board with known corners: how far off is this OpenCV?"),
    "bench": ("vbaa_calib.cli.bench", "speed against error, with the alternatives in the same run"),
    "convert": ("vbaa_calib.cli.convert", "the camera to and from ROS, OpenCV, Kalibr, mrcal and COLMAP files"),
    "schema": ("vbaa_calib.cli.schema", "print the JSON Schema of session.yaml or rig.json"),
}
