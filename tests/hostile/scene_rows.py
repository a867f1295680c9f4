"""What scene files, truth.json and object files may hold that cannot be."""

from __future__ import annotations

from . import damage as d
from .case import Case, Row, cases
from .settings_rows import NAN

SIMULATE = "simulate scene.yaml -o out"

SCENE: tuple[Row, ...] = (
    ("a list", d.content("[1]"), "must be a mapping"),
    ("a session", d.copy("session/session.yaml"), "schema"),
    ("no camera", d.at("camera", d.REMOVED), "camera"),
    ("an unknown key", d.at("colour", "red"), "colour"),
    ("a section is a number", d.at("picture", 3), "picture"),
    ("no sweeps", d.at("recording.sweeps", []), "sweeps"),
    ("a focal length below zero", d.at("camera.matrix.0.0", -502.0), "camera.matrix"),
    ("a lens that folds back", d.at("camera.distortion", [-5.0, 0, 0, 0]), "camera.distortion", "folds back"),
    ("three coefficients", d.at("camera.distortion", [0.0, 0.0, 0.0]), "camera.distortion"),
    ("a picture of a million columns", d.at("camera.image_size", [1_000_000, 360]), "camera.image_size"),
    ("two poses", d.at("camera.T_antenna_camera", {"translation_m": [0, 0, 1], "rotation_xyzw": [1, 0, 0, 0]}), "pose"),
    ("the camera at 1e300 m", d.at("camera.pose.distance_m", 1e300), "distance_m"),
    ("the camera lies in plane C", d.at("camera.pose.inclination_deg", 90.0), "inclination_deg"),
    ("length NaN", d.at("antenna.length_m", NAN), "length_m"),
    ("length of 400 digits", d.at("antenna.length_m", 10**400), "length_m"),
    ("a shape that is none", d.at("object.shape", "cow"), "object.shape"),
    ("a radius of nothing", d.at("object.radius_m", 0), "object.radius_m"),
    ("an axis of nothing", d.at("object.axis_world", [0, 0, 0]), "object.axis_world"),
    ("friction below zero", d.at("object.friction", -0.1), "object.friction"),
    ("bumps on a cylinder", d.at("object.bumps", []), "object.bumps"),
    ("a million pictures", d.at("intrinsics.pictures", 1_000_000), "intrinsics.pictures"),
    ("from far to near", d.at("intrinsics.distance_m", [0.4, 0.2]), "intrinsics.distance_m"),
    ("a load beyond the tip", d.at("loads.0.distance_m", 0.5), "distance_m"),
    ("a seed below zero", d.at("seed", -1), "seed"),
    ("a billion frames", d.at("recording.sweeps.0.frames", 10**9), "frames"),
)
TRUTH: tuple[Row, ...] = (
    ("a rig", d.copy("rig.json"), "has no object"),
    ("a list", d.content("[]"), "must be a JSON object"),
    ("cut short", d.cut(0.6), "is not valid JSON"),
    ("a shape that is none", d.at("object.shape", "cow"), "object.shape: 'cow' is not"),
    ("a radius below zero", d.at("object.radius_m", -1.0), "object.radius_m"),
    ("a centre of NaN", d.at("object.center_world_m.0", NAN), "object.center_world_m"),
    ("an axis of nothing", d.at("object.axis_world", [0, 0, 0]), "object.axis_world"),
    ("a radius of 400 digits", d.at("object.radius_m", 10**400), "object.radius_m"),
    (
        "a box without its edge",
        d.several(d.at("object.shape", "box_edge"), d.at("object.wedge_world", None)),
        "object.wedge_world",
    ),
    (
        "bumps of words",
        d.several(d.at("object.shape", "freeform"), d.at("object.bumps", "many")),
        "object.bumps",
    ),
)
REPORTED: tuple[Row, ...] = (
    *TRUTH[1:3],
    ("no frames", d.at("frames", d.REMOVED), "frames are not as expected"),
    ("a force of text", d.at("frames.1.force_N", "much"), "frames are not as expected"),
)
VTP: tuple[Row, ...] = (
    ("a text", d.content("a text"), "holds no mesh"),
    (
        "points of another number",
        d.changed(lambda data: data.replace(b'NumberOfPoints="', b'NumberOfPoints="9')),
        "mesh",
    ),
    ("no points", d.content('<VTKFile type="PolyData"><PolyData/></VTKFile>'), "holds no mesh"),
)
PLY: tuple[Row, ...] = (
    ("a text", d.content("a text"), "holds no mesh"),
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
    ("no points", d.content("ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nend_header\n"), "no mesh"),
)
GLB: tuple[Row, ...] = (
    ("a text", d.content("a text"), "holds no mesh"),
    ("a version of tomorrow", d.changed(lambda data: data[:4] + b"\x09\0\0\0" + data[8:]), "holds no mesh"),
    ("a length that is wrong", d.changed(lambda data: data[:8] + b"\xff\xff\xff\x7f" + data[12:]), "holds no mesh"),
    ("no JSON in it", d.changed(lambda data: data.replace(b"{", b"[", 1)), "holds no mesh"),
)

IMPOSSIBLE: tuple[Row, ...] = (
    ("an object out of reach", d.at("object.center_world_m", [5.0, 0.0, 0.0]), "recording.sweeps", "never meets"),
    ("an object around the clamp", d.at("object.radius_m", 0.5), "recording.sweeps"),
    ("a load of a lorry", d.at("loads.0.force_y_N", -1e5), "loads", "take a smaller load"),
    ("a sweep over its own back", d.at("recording.sweeps.0.sweep_deg", [-170.0, 170.0]), "recording.sweeps"),
)
"""A scene whose every key is possible, but not all of them together."""

CASES: list[Case] = [
    *(
        Case(name, "scene.yaml", "scene.yaml", what, SIMULATE, ("scene small", *words))
        for name, what, *words in IMPOSSIBLE
    ),
    *cases("scene.yaml", "scene.yaml", SIMULATE, SCENE),
    *cases("truth.json", "truth.json", "report contacts.csv --truth truth.json -o out.html", REPORTED),
    *cases("truth.json", "truth.json", "view contacts.csv --truth truth.json --html out.html", TRUTH),
    *cases("object.vtp", "object.vtp", "view contacts.csv --object object.vtp --html out.html", VTP),
    *cases("object.ply", "object.ply", "view contacts.csv --object object.ply --html out.html", PLY),
    *cases("object.glb", "object.glb", "view contacts.csv --object object.glb --html out.html", GLB),
]
