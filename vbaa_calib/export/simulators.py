"""The calibrated antenna, written for simulators: a chain of rigid pieces and springs, or a Cosserat rod.

A chain's hinges are in the middle of N equal parts of the rod, each as stiff as its part: the relative error of
deflections is 1/(4N²).
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np

from vbaa_calib.antenna.rod import Rod
from vbaa_calib.antenna.taper import profiles_to_dict
from vbaa_calib.core.arrays import validate_arguments
from vbaa_calib.core.errors import InputError, quoted
from vbaa_calib.core.files import refuse_overwrite, write_text
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig import Rig
from vbaa_calib.rig.parts import kinematics_to_dict


@dataclass(frozen=True)
class _ExportSettings:
    """Properties of an exported antenna that the calibration does not measure."""

    segments: int = 40  # parts of the antenna: tips are off by 1/(4N²) of their deflection
    most_segments: int = 200  # bodies within each other
    samples: int = 16  # of a part that is not uniform
    step_s: float = 5e-4  # of a simulation in MuJoCo
    damping_ratio: float = 0.01  # of the first mode; steel wires have less


@dataclass(frozen=True, eq=False)
class _Chain:
    """A rod as rigid pieces with spring hinges between them.

    Attributes
    ----------
    lengths_m, masses_kg, radii_m : (N + 1,) of the pieces; the first is fixed to the clamp.
    bending_Nm, torsion_Nm : (N,) stiffness of the hinges about the pieces' y and z, and about x.
    bend_rad : (N, 2) turn of each piece from the one before about y and z, unloaded and without weight.
    damping_s : damping of a hinge over its stiffness.
    """

    lengths_m: np.ndarray
    masses_kg: np.ndarray
    radii_m: np.ndarray
    bending_Nm: np.ndarray
    torsion_Nm: np.ndarray
    bend_rad: np.ndarray
    damping_s: float


def _parts(rod: Rod, ends_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """EI, N·m², that reproduces the bend of each part between N + 1 ends, and the part's mass per length, kg/m."""
    share = (np.arange(_ExportSettings.samples) + 0.5) / _ExportSettings.samples
    place = (ends_m[:-1, None] + np.diff(ends_m)[:, None] * share) / rod.length_m
    stiffness = 1.0 / (1.0 / rod.taper.stiffness(place)).mean(axis=1)
    weight = (rod.taper.diameter(place) ** 2).mean(axis=1)
    return rod.bending_stiffness_Nm2 * stiffness, rod.mass_per_length_kg_m * weight


def _chain_of(rig: Rig, segments: int) -> _Chain:
    """The chain of an antenna, with the clamp's compliance in its first hinge. Raises InputError for an impossible
    number of segments."""
    most = _ExportSettings.most_segments
    if isinstance(segments, bool) or not isinstance(segments, int) or not 3 <= segments <= most:
        raise InputError(f"segments are {quoted(segments)}", remedy=f"give a whole number, 3 to {most}")
    rod = rig.antenna.rod
    part_m, give_m = rod.length_m / segments, rod.clamp_give_m
    at_m = part_m * (np.arange(segments) + 0.5)
    bending = _parts(rod, part_m * np.arange(segments + 1))[0] / part_m
    torsion = bending * (rod.torsional_stiffness_Nm2 / rod.bending_stiffness_Nm2)
    if give_m <= -0.5 * part_m:
        remedy = f"give {max(3, int(-0.5 * rod.length_m / give_m))} segments or fewer"
        raise InputError(f"the clamp gives by {1e3 * give_m:.3g} mm", where="antenna", remedy=remedy)
    yielded = 1.0 + give_m / rod.bending_stiffness_Nm2 * bending[0]
    bending[0] /= yielded
    at_m[0] /= yielded
    ends = np.concatenate([[0.0], at_m, [rod.length_m]])
    lengths, mass = np.diff(ends), _parts(rod, ends)[1]
    radii = rig.antenna.radius_at(ends[:-1] + 0.5 * lengths)
    first_mode = 3.516 * np.sqrt(rod.bending_stiffness_Nm2 / max(rod.mass_per_length_kg_m, 1e-9)) / rod.length_m**2
    bow = np.tile(part_m * np.asarray(rod.natural_curvature_per_m, float), (segments, 1))
    return _Chain(
        lengths, mass * lengths, radii, bending, torsion, bow, 2.0 * _ExportSettings.damping_ratio / first_mode
    )


def _text(values: Any) -> str:
    return " ".join(f"{value:.9g}" for value in np.atleast_1d(np.asarray(values, float)))


def _placed(pose: Pose) -> dict[str, str]:
    """A pose as MuJoCo's attributes pos and quat."""
    x, y, z, w = pose.to_dict()["rotation_xyzw"]
    return {"pos": _text(pose.translation_m), "quat": _text([w, x, y, z])}


def _inertia(mass_kg: float, length_m: float, radius_m: float) -> np.ndarray:
    """(3,) moments of inertia of a cylinder along x about its axes."""
    across = mass_kg * (3.0 * radius_m**2 + length_m**2) / 12.0
    return np.array([0.5 * mass_kg * radius_m**2, across, across])


def _add(parent: Xml.Element, tag: str, **attributes: str) -> Xml.Element:
    return Xml.SubElement(parent, tag, attributes)


def _as_xml(root: Xml.Element) -> str:
    Xml.indent(root)
    return Xml.tostring(root, encoding="unicode") + "\n"


def _hinges(chain: _Chain) -> list[tuple[Pose, list[tuple[str, str, float]]]]:
    """Hinges of the chain, per place: the pose of the next piece in the previous one; name, axis and stiffness of
    its joints."""
    found = []
    for number, bend in enumerate(chain.bend_rad):
        pose = Pose.from_rotvec(np.array([0.0, *bend]), np.array([chain.lengths_m[number], 0.0, 0.0]))
        stiff = (("y", "0 1 0", chain.bending_Nm), ("z", "0 0 1", chain.bending_Nm), ("x", "1 0 0", chain.torsion_Nm))
        found.append((pose, [(f"{axis}{number}", of, float(k[number])) for axis, of, k in stiff]))
    return found


def _tilt_in_pan(joints: Kinematics) -> Pose:
    """Pose of the tilt joint in the pan link's frame; its zero is a rotation about its own axis, y."""
    skew = Pose.from_rotvec(np.array([joints.axis_skew_rad, 0.0, 0.0]), np.array([joints.axis_offset_m, 0.0, 0.0]))
    return skew @ Pose.from_rotvec(np.array([0.0, -joints.tilt_zero_rad, 0.0]), np.zeros(3))


def _add_chain(base: Xml.Element, chain: _Chain, rig: Rig) -> None:
    """Adds the chain as nested bodies with their joints, up to the site `tip`."""
    piece = _add(base, "body", name="piece0", **_placed(rig.antenna.rod.T_antenna_clamp))
    bends, pieces = _hinges(chain), zip(chain.lengths_m, chain.masses_kg, chain.radii_m, strict=True)
    for number, (length, mass, radius) in enumerate(pieces):
        if number:
            pose, hinges = bends[number - 1]
            piece = _add(piece, "body", name=f"piece{number}", **_placed(pose))
            for name, axis, stiffness in hinges:
                _add(
                    piece,
                    "joint",
                    name=name,
                    axis=axis,
                    stiffness=_text(stiffness),
                    damping=_text(stiffness * chain.damping_s),
                    armature=_text(
                        stiffness * _ExportSettings.step_s**2
                    ),  # so that the fastest mode keeps to the time step
                )
        middle, inertia = _text([0.5 * length, 0.0, 0.0]), _inertia(mass, length, radius)
        _add(piece, "inertial", pos=middle, mass=_text(mass), diaginertia=_text(inertia))
        ends, size = _text([0.0, 0.0, 0.0, length, 0.0, 0.0]), _text(radius)
        # touches others, not itself
        _add(piece, "geom", type="capsule", fromto=ends, size=size, contype="2", conaffinity="1")
    _add(piece, "site", name="tip", pos=_text([chain.lengths_m[-1], 0.0, 0.0]))


def _mujoco(rig: Rig, segments: int) -> str:
    """An MJCF document, which Newton reads, too: joints with servos, camera, moment sensor, and the antenna as a
    chain."""
    chain, joints, camera = _chain_of(rig, segments), rig.kinematics, rig.camera
    root = Xml.Element("mujoco", model="antenna")
    root.append(Xml.Comment(" SI units. Servos, attachment and damping are not measured: change them as you like. "))
    _add(root, "compiler", angle="radian", autolimits="true")
    gravity, step = _text(rig.gravity_world_m_s2), _text(_ExportSettings.step_s)
    _add(root, "option", gravity=gravity, timestep=step, integrator="implicitfast")
    custom, sensor = _add(root, "custom"), rig.moment_sensor
    if sensor.exists:
        for name, value in (("gain", sensor.gain), ("offset_Nm", sensor.offset_Nm), ("std_Nm", sensor.std_Nm)):
            _add(custom, "numeric", name=f"moment_{name}", data=_text(value))
    world = _add(root, "worldbody")
    pan = _add(world, "body", name="pan", pos=_text(joints.position_world_m))
    tilt = _add(pan, "body", name="tilt", **_placed(_tilt_in_pan(joints)))
    for body, axis in ((pan, "0 0 1"), (tilt, "0 -1 0")):
        _add(body, "inertial", pos="0 0 0", mass="0.1", diaginertia="1e-4 1e-4 1e-4")
        _add(body, "joint", name=body.attrib["name"], axis=axis, armature="0.1")
    base = _add(tilt, "body", name="antenna", **_placed(joints.T_actuator_antenna))
    _add(base, "site", name="clamp")
    (width, height), (fx, fy, cx, cy) = camera.image_size, camera.parameters[:4]
    _add(
        base,
        "camera",
        name="camera",
        # MuJoCo's cameras look along −z, with y up
        **_placed(rig.T_antenna_camera @ Pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3))),
        resolution=f"{width} {height}",
        sensorsize=_text([width * 1e-6, height * 1e-6]),  # pixels of 1 µm: only ratios count
        focalpixel=_text([fx, fy]),
        principalpixel=_text([0.5 * (width - 1) - cx, 0.5 * (height - 1) - cy]),
    )
    _add_chain(base, chain, rig)
    servos, sensors = _add(root, "actuator"), _add(root, "sensor")
    for name in ("pan", "tilt"):
        _add(servos, "position", name=name, joint=name, kp="1000", dampratio="1")
    # its y is the moment of force and weight as our files have it
    _add(sensors, "torque", name="moment", site="clamp")
    _add(sensors, "framepos", name="tip", objtype="site", objname="tip")
    return _as_xml(root)


def _urdf(rig: Rig, segments: int) -> str:
    """A URDF document with the springs in Gazebo's elements: URDF itself has no springs, gravity or moment sensors."""
    chain, joints = _chain_of(rig, segments), rig.kinematics
    root = Xml.Element("robot", name="antenna")

    def link(name: str, mass: float, length: float, radius: float, inertia: np.ndarray) -> None:
        one = _add(root, "link", name=name)
        inertial = _add(one, "inertial")
        _add(inertial, "origin", xyz=_text([0.5 * length, 0.0, 0.0]), rpy="0 0 0")
        _add(inertial, "mass", value=_text(mass))
        ixx, iyy, izz = map(_text, inertia)
        _add(inertial, "inertia", ixx=ixx, iyy=iyy, izz=izz, ixy="0", ixz="0", iyz="0")
        for kind in ("visual", "collision") if length else ():
            part = _add(one, kind)
            _add(part, "origin", xyz=_text([0.5 * length, 0.0, 0.0]), rpy=_text([0.0, 0.5 * np.pi, 0.0]))
            geometry = _add(part, "geometry")
            _add(geometry, "cylinder", radius=_text(radius), length=_text(length))

    def joint(names: tuple[str, str, str], pose: Pose, axis: str = "", stiffness: float = 0.0) -> None:
        name, parent, child = names
        one = _add(root, "joint", name=name, type="revolute" if axis else "fixed")
        turn = pose.rotation
        yaw, pitch = np.arctan2(turn[1, 0], turn[0, 0]), np.arcsin(np.clip(-turn[2, 0], -1.0, 1.0))
        roll = np.arctan2(turn[2, 1], turn[2, 2])
        _add(one, "parent", link=parent)
        _add(one, "child", link=child)
        _add(one, "origin", xyz=_text(pose.translation_m), rpy=_text([roll, pitch, yaw]))
        if axis:
            _add(one, "axis", xyz=axis)
            _add(one, "limit", lower="-3.14159", upper="3.14159", effort="100", velocity="100")
        if stiffness:
            _add(one, "dynamics", damping=_text(stiffness * chain.damping_s), friction="0")
            spring = _add(root, "gazebo", reference=name)
            _add(spring, "springStiffness").text = _text(stiffness)
            _add(spring, "springReference").text = "0"

    place = Pose(np.eye(3), joints.position_world_m)
    _add(root, "link", name="world")
    for name in ("pan_link", "tilt_link", "antenna", "camera"):
        link(name, 0.01, 0.0, 0.0, np.full(3, 1e-5))  # not measured
    joint(("pan", "world", "pan_link"), place, "0 0 1")
    joint(("tilt", "pan_link", "tilt_link"), _tilt_in_pan(joints), "0 -1 0")
    joint(("mount", "tilt_link", "antenna"), joints.T_actuator_antenna)
    joint(("camera_mount", "antenna", "camera"), rig.T_antenna_camera)
    pieces = np.stack([chain.masses_kg, chain.lengths_m, chain.radii_m], axis=1).tolist()
    mass, length, radius = pieces[0]
    link("piece0", mass, length, radius, _inertia(mass, length, radius))
    joint(("clamp", "antenna", "piece0"), rig.antenna.rod.T_antenna_clamp)
    places = zip(_hinges(chain), pieces[1:], strict=True)
    for number, ((pose, hinges), (mass, length, radius)) in enumerate(places, 1):
        parent, inertia = f"piece{number - 1}", _inertia(mass, length, radius)
        for name, axis, stiffness in hinges:
            last = axis == hinges[-1][1]
            child = f"piece{number}" if last else f"hinge_{name}"
            # links between the hinges of one place weigh next to nothing, which importers refuse where it is nothing
            light = 1e-3 * mass, 0.0, 0.0, np.full(3, 1e-2 * inertia[1])
            link(child, *((0.998 * mass, length, radius, inertia) if last else light))
            joint((name, parent, child), pose, axis, stiffness)
            parent, pose = child, Pose.identity()
    return _as_xml(root)


def _numbers(rig: Rig, segments: int) -> dict[str, Any]:
    """Rod, chain, joints, camera, sensor and gravity as plain numbers with their units in their names."""
    rod, chain, camera = rig.antenna.rod, _chain_of(rig, segments), rig.camera
    sensor = rig.moment_sensor
    return {
        "schema": "vbaa.antenna/1",
        "rod": {
            "length_m": rod.length_m,
            "diameter_m": rig.antenna.diameter_m,
            **profiles_to_dict(rig.antenna),
            "bending_stiffness_Nm2": rod.bending_stiffness_Nm2,
            "bending_stiffness_std_Nm2": rod.bending_stiffness_Nm2 * rig.std("log_stiffness_Nm2"),
            "torsional_stiffness_Nm2": rod.torsional_stiffness_Nm2,
            "mass_per_length_kg_m": rod.mass_per_length_kg_m,
            "natural_curvature_yz_per_m": rod.natural_curvature_per_m.tolist(),
            "clamp_give_m": rod.clamp_give_m,
            "T_antenna_clamp": rod.T_antenna_clamp.to_dict(),
        },
        "chain": {name: np.asarray(getattr(chain, name)).tolist() for name in _Chain.__dataclass_fields__},
        "joints": kinematics_to_dict(rig.kinematics),
        "T_antenna_camera": rig.T_antenna_camera.to_dict(),
        "camera": {"model": camera.model, "image_size": list(camera.image_size)}
        | dict(zip(camera.parameter_names, camera.parameters.tolist(), strict=True)),
        "moment_sensor": {"gain": sensor.gain, "offset_Nm": sensor.offset_Nm, "std_Nm": sensor.std_Nm}
        if sensor.exists
        else None,
        "gravity_world_m_s2": rig.gravity_world_m_s2.tolist(),
    }


def _json(rig: Rig, segments: int) -> str:
    return json.dumps(_numbers(rig, segments), indent=2, allow_nan=False) + "\n"


def _pyelastica(rig: Rig, segments: int) -> str:
    """A Python file with the rod's numbers, and the code that builds it in PyElastica."""
    if rig.antenna.taper:
        raise InputError("the antenna is not uniform", where="pyelastica", remedy="export to mujoco, urdf-beam or json")
    numbers, turn = _numbers(rig, segments), rig.kinematics.T_world_antenna(0.0, 0.0).rotation
    kept = numbers["rod"] | {"segments": segments, "gravity_m_s2": (rig.gravity_world_m_s2 @ turn).tolist()}
    clamp = rig.antenna.rod.T_antenna_clamp
    del kept["T_antenna_clamp"], kept["bending_stiffness_std_Nm2"]
    kept |= {"clamp_m": clamp.translation_m.tolist(), "clamp_axes": clamp.rotation.T.tolist()}
    lines = "".join(f"    {key}={value!r},\n" for key, value in kept.items())
    template = files(__package__).joinpath("pyelastica.txt").read_text(encoding="utf-8")
    return template.replace("    NUMBERS,\n", lines)


EXPORTS: dict[str, tuple[Callable[[Rig, int], str], str, str]] = {
    "mujoco": (_mujoco, "MJCF for MuJoCo and Newton", "the lens's distortion (its camera is a pinhole)"),
    "pyelastica": (_pyelastica, "Python file for PyElastica", "camera, joints, moment sensor"),
    "urdf-beam": (_urdf, "URDF of a chain, with Gazebo's springs", "lens, moment sensor, gravity"),
    "json": (_json, "plain numbers", "covariances (rig.json has them)"),
}
"""Name on the command line → what writes the text, what it is, and what it has no place for."""


@validate_arguments
def export(
    rig: Rig, to: str, output: str | Path, *, segments: int = _ExportSettings.segments, force: bool = False
) -> None:
    """Write the solved antenna for a simulator.

    Parameters
    ----------
    to : one of `EXPORTS`: mujoco (MJCF, for Newton, too), pyelastica (a Python file), urdf-beam, json.
    segments : parts of the antenna; the tip's deflection is off by 1/(4N²) of itself.

    Raises
    ------
    InputError : an unknown simulator, an impossible number of segments, or a file that exists (without `force`).
    """
    if to not in EXPORTS:
        raise InputError(f"to is {quoted(to)}", remedy=f"give one of {', '.join(EXPORTS)}")
    refuse_overwrite(Path(output), force)
    write_text(Path(output), EXPORTS[to][0](rig, segments), force)
