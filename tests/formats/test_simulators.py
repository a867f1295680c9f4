"""What is exported for simulators: its springs, masses and frames are the rod's, by mechanics written anew here."""

from __future__ import annotations

import json
import os
import runpy
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree as Xml

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import vbaa
from benchmarks.estimator.setup import Setup
from estimator import rod as public_rod
from vbaa_calib.antenna.rod import solve_rod
from vbaa_calib.antenna.shape import bend
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import Rig


def a_rig() -> Rig:
    """With everything that an antenna and joints may have."""
    rig = Setup(real=True).rig()
    parameters = rig.antenna.parameters.copy()
    parameters[4:6], parameters[8] = [0.3, -0.2], 1.5e-3
    joints = replace(
        rig.kinematics,
        T_actuator_antenna=Pose.from_rotvec(np.array([0.1, -0.2, 0.3]), np.array([0.01, 0.0, 0.02])),
        position_world_m=np.array([0.1, 0.2, 0.3]),
        axis_skew_rad=0.02,
        axis_offset_m=0.01,
        tilt_zero_rad=0.03,
    )
    return replace(rig, antenna=replace(rig.antenna, parameters=parameters), kinematics=joints)


@dataclass
class Link:
    """Where a link stands in the one before, what it turns about there, and what it weighs."""

    name: str
    pose: Pose
    joints: list[tuple[str, np.ndarray, float]]
    mass_kg: float
    centre_m: np.ndarray


def floats(text: str | None) -> np.ndarray:
    return np.array((text or "").split(), float)


def links_of_mjcf(path: Path) -> Iterator[Link]:
    """From the world to the tip; the tip itself comes last."""
    body: Xml.Element | None = Xml.parse(path).getroot().find("worldbody")
    assert body is not None
    while (found := body.find("body")) is not None:
        body = found
        quat, inertial = floats(body.get("quat", "1 0 0 0")), body.find("inertial")
        pose = Pose.from_quaternion(np.roll(quat, -1), floats(body.get("pos")))
        joints = [
            (one.attrib["name"], floats(one.get("axis")), float(one.get("stiffness", "inf")))
            for one in body.findall("joint")
        ]
        mass = (0.0, np.zeros(3)) if inertial is None else (float(inertial.attrib["mass"]), floats(inertial.get("pos")))
        yield Link(body.attrib["name"], pose, joints, *mass)
    tip = next(one for one in body.findall("site") if one.get("name") == "tip")
    yield Link("tip", Pose(np.eye(3), floats(tip.get("pos"))), [], 0.0, np.zeros(3))


def links_of_urdf(path: Path) -> Iterator[Link]:
    root, name = Xml.parse(path).getroot(), "world"
    springs = {one.get("reference"): float(one.findtext("springStiffness", "")) for one in root.findall("gazebo")}
    by_name = {one.get("name"): one for one in root.findall("link")}
    length = 0.0
    while True:
        after = [one for one in root.findall("joint") if one.find("parent").get("link") == name]  # type: ignore[union-attr]
        after = [one for one in after if one.get("name") != "camera_mount"]
        if not after:
            break
        (joint,) = after
        origin, axis, child = joint.find("origin"), joint.find("axis"), joint.find("child")
        assert origin is not None
        assert child is not None
        name = child.attrib["link"]
        pose = Pose(Rotation.from_euler("xyz", floats(origin.get("rpy"))).as_matrix(), floats(origin.get("xyz")))
        own = str(joint.get("name"))
        joints = [] if axis is None else [(own, floats(axis.get("xyz")), springs.get(own, np.inf))]
        inertial = by_name[name].find("inertial")
        assert inertial is not None
        mass, centre = inertial.find("mass"), inertial.find("origin")
        assert mass is not None
        assert centre is not None
        yield Link(name, pose, joints, float(mass.attrib["value"]), floats(centre.get("xyz")))
        cylinder = by_name[name].find("visual/geometry/cylinder")
        length = 0.0 if cylinder is None else float(cylinder.attrib["length"])
    yield Link("tip", Pose(np.eye(3), np.array([length, 0.0, 0.0])), [], 0.0, np.zeros(3))


def at_rest(links: list[Link], angles: dict[str, float], gravity: np.ndarray, force: np.ndarray) -> np.ndarray:
    """(3,) the tip in the world: each spring turned by the moment on it, until that no longer changes."""
    turns = np.zeros(sum(len(link.joints) for link in links))
    for _ in range(200):
        place, seen, loads, number = Pose.identity(), [], [], 0
        for link in links:
            place = place @ link.pose
            for name, axis, stiffness in link.joints:
                seen.append((place.translation_m, place.rotation @ axis, stiffness))
                place = place @ Pose.from_rotvec(axis * angles.get(name, turns[number]), np.zeros(3))
                number += 1
            loads.append((number, place @ link.centre_m, link.mass_kg * gravity))
        loads.append((number, place.translation_m, force))
        origins, axes = (np.array(each) for each in list(zip(*seen, strict=True))[:2])
        after, at, pulls = (np.array(each) for each in zip(*loads, strict=True))
        beyond = (after > np.arange(len(seen))[:, None]).astype(float)  # which loads hang on which joint
        moments = (axes * (beyond @ np.cross(at, pulls) - np.cross(origins, beyond @ pulls))).sum(axis=1)
        wanted = moments / np.array([stiffness for *_, stiffness in seen])
        if np.abs(wanted - turns).max() < 1e-10:
            break
        turns += 0.5 * (wanted - turns)
    return place.translation_m


@pytest.mark.parametrize("tapers", [False, True])
@pytest.mark.parametrize(("to", "links_of"), [("mujoco", links_of_mjcf), ("urdf-beam", links_of_urdf)])
def test_a_chain_hangs_and_bends_as_the_rod(to: str, links_of: object, tapers: bool, tmp_path: Path) -> None:
    """Clamp and its give, bow, weight, EI, GJ, length, taper and joints: the tip is the rod's to 1/(4N²) of its
    deflection."""
    rig, angles = a_rig(), {"pan": 0.4, "tilt": -0.3}
    if tapers:
        rows = ((0.0, 0.8e-3), (0.1, 0.7e-3), (0.1, 0.6e-3), (rig.antenna.length_m, 0.5e-3))
        rig = replace(rig, antenna=replace(rig.antenna, profile=rows))  # which bends about twice as far
    carried = rig.kinematics.T_world_antenna(angles["pan"], angles["tilt"])
    force = np.array([0.002, 0.03, -0.02])
    for segments, most in ((10, 1.5e-3), (20, 4e-4)):
        path = tmp_path / f"{segments}"
        vbaa.export(rig, to, path, segments=segments)
        links = list(links_of(path))  # type: ignore[operator]
        weight = sum(link.mass_kg for link in links if link.name.startswith(("piece", "hinge")))
        np.testing.assert_allclose(weight, rig.antenna.rod.mass_kg, rtol=1e-3 if tapers else 1e-7)
        tip = at_rest(links, angles, rig.gravity_world_m_s2, carried.rotation @ force)
        gravity = rig.gravity_world_m_s2 @ carried.rotation
        ours = public_rod.solve(rig, force, gravity_m_s2=gravity).points_m[-1]
        assert np.linalg.norm(tip - carried @ ours) < (1 + tapers) * most * rig.antenna.length_m


def test_a_clamp_that_gives_is_the_estimators() -> None:
    """Two programs for the same: shooting with a turned clamp, and sweeps over the equilibrium."""
    rig = a_rig()
    force, contact = np.array([[0.0, 0.05, -0.03], [0.0, -0.02, 0.04]]), np.array([0.1, 0.24])
    rod = rig.antenna.rod
    gravity = np.array([[1.0, 2.0, -9.0]] * 2)
    shape = solve_rod(rod, gravity, contact, force)
    parameters = np.tile(rig.antenna.parameters, (2, 1))
    theirs = bend(parameters, rod.length_m, gravity, contact, force[:, 1:], dead=True, sweeps=30)
    np.testing.assert_allclose(shape.points_m[:, -1], theirs.points_m[:, -1], rtol=0, atol=1e-6 * rod.length_m)
    np.testing.assert_allclose(-shape.clamp_moment_Nm[:, 1], theirs.moment_Nm, rtol=0, atol=1e-7)
    with pytest.raises(InputError, match="clamp_give_m"):
        replace(rod, clamp_give_m=1.0)


def test_the_pinhole_and_the_numbers_are_the_rigs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = a_rig()
    for to, name in (("mujoco", "a.xml"), ("json", "a.json"), ("pyelastica", "a.py")):
        vbaa.export(rig, to, tmp_path / name)
    camera = Xml.parse(tmp_path / "a.xml").getroot().find(".//camera")
    assert camera is not None
    turn = Rotation.from_quat(np.roll(floats(camera.get("quat")), -1)).as_matrix()
    np.testing.assert_allclose(turn * [1, -1, -1], rig.T_antenna_camera.rotation, atol=1e-6)
    numbers = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    rod = rig.antenna.rod
    assert numbers["rod"]["bending_stiffness_Nm2"] == rod.bending_stiffness_Nm2
    assert sum(numbers["chain"]["lengths_m"]) == pytest.approx(rod.length_m)
    # in its place, for a file that only names the parts of it
    parts = ("BaseSystemCollection", "Constraints", "Forcing", "Damping")
    monkeypatch.setitem(sys.modules, "elastica", SimpleNamespace(**{part: type(part, (), {}) for part in parts}))
    written = runpy.run_path(str(tmp_path / "a.py"))["ANTENNA"]
    assert written.bending_stiffness_Nm2 == rod.bending_stiffness_Nm2
    np.testing.assert_allclose(np.transpose(written.clamp_axes), rod.T_antenna_clamp.rotation)


@pytest.mark.slow
@pytest.mark.skipif("VBAA_PEER_PYTHON" not in os.environ, reason="no interpreter with MuJoCo or PyElastica is named")
def test_simulators_agree_with_the_rod() -> None:
    """To 0.1 % of the length, in those that are there."""
    call = [sys.executable, "-m", "vbaa_calib", "bench", "simulators", "--quick", "--json"]
    found = json.loads(subprocess.run(call, capture_output=True, text=True, check=True).stdout)
    assert found["within"] or len(found["absent"]) == 2
