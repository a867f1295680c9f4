"""Every file of ours: what is written is what is read, to the last bit, with numbers as extreme as a file may hold.

Where a file holds fewer digits by design (contacts.csv: nine), the second pass is the same as the first, byte by byte.
"""

from __future__ import annotations

import csv
import struct
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.table.contacts import ContactRow, ContactTable
from estimator.table.files import read_contacts, write_contacts
from targets.board import BoardSpec
from targets.sheet import spec_document
from vbaa_calib.camera import Camera
from vbaa_calib.convert.exchanged import Exchanged
from vbaa_calib.convert.table import FORMATS
from vbaa_calib.core.files import read_json, read_yaml, write_json, write_text
from vbaa_calib.core.yaml_text import UniqueKeyDumper
from vbaa_calib.detect.board.board_file import load_board
from vbaa_calib.rig import Antenna, Rig
from vbaa_calib.session import read_centrelines, read_noload, read_recording
from vbaa_calib.wizard.state.journal import AcceptedPicture, Journal, RefusedPicture, StepRecord
from vbaa_calib.wizard.state.session_file import write_table
from viz.files.glb import glb_bytes
from viz.files.object_file import read_object, to_mesh, vtp_text
from viz.files.ply import ply_bytes
from viz.scene.scene import ObjectMesh

from ..test_rig import make_rig

QUICK = settings(max_examples=40, deadline=None, derandomize=True, database=None)
ANY = st.floats(allow_nan=False, allow_infinity=False)
EXTREME = st.sampled_from(
    [0.0, -0.0, 5e-324, -5e-324, 2.2250738585072014e-308, 1.7976931348623157e308, 0.1 + 0.2, 1e22]
)
NUMBER = ANY | EXTREME
LENGTH = st.floats(1e-3, 9.0, exclude_max=True)
WORD = st.text(st.characters(codec="utf-8", exclude_categories=["Cs", "Cc"]), max_size=12) | st.sampled_from(
    ["1e5", "1.0e5", "yes", "null", "~", "0x1f", "1:30", "2026-01-01", "", " ", "=", "<<", ".5e3", "+1e1"]
)


def bits(value: Any) -> Any:
    """For comparison: 0.0 and −0.0 are two numbers."""
    if isinstance(value, float):
        return struct.pack("<d", value)
    if isinstance(value, dict):
        return {key: bits(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [bits(one) for one in value]
    return value


def same(one: Any, other: Any) -> bool:
    return np.asarray(one, float).tobytes() == np.asarray(other, float).tobytes()


def passed(name: str, write: Callable[[Path], object], read: Callable[[Path], Any]) -> Any:
    """Written to a file of this name and read again."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        return read(path)


NESTED = st.recursive(
    NUMBER | WORD | st.booleans() | st.none() | st.integers(-(2**80), 2**80),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORD, inner, max_size=3),
    max_leaves=8,
)


@QUICK
@given(data=st.dictionaries(WORD, NESTED, min_size=1, max_size=4))
def test_json(data: dict[str, Any]) -> None:
    assert bits(passed("a.json", lambda path: write_json(path, data), read_json)) == bits(data)


@QUICK
@given(data=st.dictionaries(WORD, NESTED, min_size=1, max_size=4))
def test_yaml(data: dict[str, Any]) -> None:
    """As the wizard writes session.yaml."""
    text = yaml.dump(data, Dumper=UniqueKeyDumper, sort_keys=False, default_flow_style=None, allow_unicode=True)
    assert bits(passed("a.yaml", lambda path: write_text(path, text), read_yaml)) == bits(data)


@QUICK
@given(
    square=LENGTH,
    share=st.floats(1e-6, 1 - 1e-6),
    thickness=LENGTH | st.sampled_from([0.0, 5e-324]),
    legacy=st.booleans(),
)
def test_board_yaml(square: float, share: float, thickness: float, legacy: bool) -> None:
    spec = BoardSpec(11, 7, square, square * share, "DICT_5X5_250", legacy, thickness)
    assert passed("board.yaml", lambda path: write_text(path, spec_document(spec, "a note")), load_board) == spec


CORE = st.floats(1.0, 1e5)
COEFFICIENTS = st.sampled_from([0, 4, 5, 8, 12, 14]).flatmap(
    lambda count: st.lists(st.floats(-1e-3, 1e-3) | st.sampled_from([0.0, 1e-200]), min_size=count, max_size=count)
)


@st.composite
def cameras(draw: st.DrawFn, covariance: bool = True) -> Camera:
    fx, fy, cx, cy = draw(CORE), draw(CORE), draw(CORE), draw(CORE)
    distortion = np.array(draw(COEFFICIENTS))
    spread = None
    if covariance and draw(st.booleans()):
        factor = np.array(
            draw(st.lists(st.floats(1e-9, 1e3), min_size=4 + distortion.size, max_size=4 + distortion.size))
        )
        spread = np.diag(factor**2)
    return Camera("opencv", (640, 480), np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), distortion, spread)


@QUICK
@given(camera=cameras())
def test_camera_json(camera: Camera) -> None:
    back = passed("camera.json", lambda path: write_json(path, camera.to_dict()), Camera.load)
    assert bits(back.to_dict()) == bits(camera.to_dict())


@pytest.mark.parametrize("name", sorted(FORMATS))
@settings(max_examples=15, deadline=None, derandomize=True, database=None)
@given(camera=cameras(covariance=False))
def test_other_programs_files(name: str, camera: Camera) -> None:
    """Matrix and coefficients to the bit; no coefficients come back as zeros where the format has no place for none."""
    target = FORMATS[name]
    if camera.distortion.size not in HELD[name]:
        return
    back = passed(
        "f.txt", lambda path: path.write_text(target.write(Exchanged(camera))), lambda path: target.read(path, None)
    )
    assert back.camera.image_size == camera.image_size
    assert same(back.camera.matrix, camera.matrix)
    given = camera.distortion
    if given.size:
        assert same(back.camera.distortion, given)
    else:
        assert not np.any(back.camera.distortion)


HELD = {
    "vbaa": (0, 4, 5, 8, 12, 14),
    "ros": (5, 8),
    "opencv": (0, 4, 5, 8, 12, 14),
    "kalibr": (4,),
    "mrcal": (0, 4, 5, 8, 12),
    "colmap": (4,),
}
"""Format → how many coefficients it holds as they are."""


@settings(max_examples=8, deadline=None, derandomize=True, database=None)
@given(
    seed=st.integers(0, 10**6),
    bow=st.lists(st.floats(-0.5, 0.5) | st.sampled_from([-0.0, 5e-324]), min_size=6, max_size=6),
    log_stiffness=st.floats(-20.0, 9.0),
)
def test_rig_json(seed: int, bow: list[float], log_stiffness: float) -> None:
    """To the bit but for what the file holds in another form: a turn as a quaternion, EI and mass not as logarithms."""
    rig = make_rig(seed)
    antenna = Antenna(0.24, 0.0008, np.array([*bow, log_stiffness, *rig.antenna.parameters[7:]]))
    rig = Rig(**{name: getattr(rig, name) for name in Rig.__dataclass_fields__} | {"antenna": antenna})
    back = passed("rig.json", lambda path: write_json(path, rig.to_dict()), Rig.load)
    assert same(back.camera.matrix, rig.camera.matrix)
    assert same(back.camera.distortion, rig.camera.distortion)
    assert same(back.covariance, rig.covariance)
    assert same(back.antenna.parameters[:6], bow)
    assert same(back.T_antenna_camera.translation_m, rig.T_antenna_camera.translation_m)
    assert same(back.gravity_world_m_s2, rig.gravity_world_m_s2)
    assert back.moment_sensor == rig.moment_sensor
    assert back.image == rig.image
    assert np.abs(back.antenna.parameters - antenna.parameters).max() < 1e-14
    assert np.abs(back.T_antenna_camera.rotation - rig.T_antenna_camera.rotation).max() < 1e-15


COUNT = st.integers(1, 4)
SIGNED = NUMBER.filter(lambda value: abs(value) < 1e150)

TRIPLE = st.lists(SIGNED, min_size=3, max_size=3)


@st.composite
def contact_rows(draw: st.DrawFn) -> list[ContactRow]:
    rows = []
    for frame in range(draw(COUNT)):
        rows.append(
            ContactRow(
                frame=frame,
                time_s=float(frame) / 3,
                status="ok",
                in_contact=True,
                model="rod",
                distance_m=draw(SIGNED),
                distance_std_m=abs(draw(SIGNED)),
                force_y_N=draw(SIGNED),
                force_z_N=draw(SIGNED),
                point_antenna_m=np.array(draw(TRIPLE)),
                point_world_m=np.array(draw(TRIPLE)),
                covariance_world_m2=np.diag([draw(st.floats(1e-12, 1.0)) for _ in range(3)]),
                reason=draw(st.text(st.characters(codec="ascii", categories=["L", "N", "P"]), max_size=20)),
            )
        )
    return rows


@QUICK
@given(rows=contact_rows())
def test_contacts_csv(rows: list[ContactRow]) -> None:
    with TemporaryDirectory() as folder:
        first, second = Path(folder, "first.csv"), Path(folder, "second.csv")
        write_contacts(first, rows)
        read = read_contacts(first)
        for name in ("distance_m", "force_y_N", "point_world_m"):
            written = np.array([getattr(row, name) for row in rows])
            np.testing.assert_allclose(getattr(read, name), written, rtol=1e-8, atol=5e-323)
        write_contacts(second, [row_of(read, index) for index in range(len(read))])
        assert second.read_bytes() == first.read_bytes()


def row_of(table: ContactTable, index: int) -> ContactRow:
    values = {name: getattr(table, name)[index] for name in ContactRow.__dataclass_fields__}
    return ContactRow(**values)


@QUICK
@given(values=st.lists(st.tuples(st.floats(-6, 6), st.floats(-6, 6), NUMBER), min_size=1, max_size=3))
def test_the_wizards_tables(values: list[tuple[float, float, float]]) -> None:
    names = ("pan_rad", "tilt_rad", "moment_Nm")
    taken = [
        AcceptedPicture(file=f"noload/{k}.png", source="", sha256="", readings=dict(zip(names, one, strict=True)))
        for k, one in enumerate(values)
    ]
    with TemporaryDirectory() as folder:
        root = Path(folder)
        (root / "noload").mkdir()
        for one in taken:
            (root / one.file).touch()
        write_table(root / "noload" / "noload.csv", "noload", taken)
        stills = read_noload(SimpleNamespace(root=root))  # only its root is asked for
    assert same([[getattr(still, name) for name in names] for still in stills], values)


@QUICK
@given(
    times=st.lists(st.floats(0, 1e18) | st.sampled_from([5e-324, 0.1 + 0.2]), min_size=1, max_size=4),
    moment=NUMBER,
    points=st.lists(
        st.tuples(st.floats(-1e7, 1e7) | st.sampled_from([-0.0, 5e-324]), st.floats(-1e7, 1e7), st.floats(5e-324, 1e7)),
        min_size=1,
        max_size=4,
        unique_by=lambda point: point[:2],
    ),
)
def test_a_recording(times: list[float], moment: float, points: list[tuple[float, float, float]]) -> None:
    with TemporaryDirectory() as folder:
        root = Path(folder)
        (root / "recording").mkdir()
        table(root / "recording" / "recording.csv", "frame,time_s,pan_rad,tilt_rad,moment_Nm",
              [(k, time, 0.1, -0.0, moment) for k, time in enumerate(sorted(times))])  # fmt: skip
        table(root / "recording" / "centrelines.csv", "frame,u_px,v_px,sigma_px", [(0, *point) for point in points])
        frames, lines = (
            list(read_recording(SimpleNamespace(root=root))),
            dict(read_centrelines(SimpleNamespace(root=root))),
        )
    assert same([frame.time_s for frame in frames], sorted(times))
    assert same([frame.moment_Nm for frame in frames], [moment] * len(times))
    assert same(lines[0], points)


def table(path: Path, header: str, rows: list[tuple[float, ...]]) -> None:
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(header.split(","))
        writer.writerows([[repr(value) for value in row] for row in rows])


READINGS = st.fixed_dictionaries(dict.fromkeys(("pan_rad", "tilt_rad", "moment_Nm"), NUMBER))


@QUICK
@given(readings=st.lists(READINGS, max_size=3), why=WORD, length=NUMBER, turn=st.lists(NUMBER, min_size=3, max_size=3))
def test_the_wizards_journal(readings: list[dict[str, float]], why: str, length: float, turn: list[float]) -> None:
    taken = tuple(
        AcceptedPicture(file=f"noload/{k}.png", source=why, sha256="ab", readings=one) for k, one in enumerate(readings)
    )
    refused = RefusedPicture(source=why, sha256="cd", why=why)
    journal = Journal(
        answers={"antenna_length_mm": length, "jig_turn_deg": turn, "source": why},
        steps={"noload": StepRecord(taken=taken, left=(refused,), closed="by hand")},
        redone=("lens",),
    )
    back = passed("wizard.json", lambda path: write_json(path, journal.to_dict()), Journal.read)
    assert bits(back.to_dict()) == bits(journal.to_dict())


@st.composite
def surfaces(draw: st.DrawFn) -> SimpleNamespace:
    count = draw(st.integers(3, 6))
    near = st.floats(-1e3, 1e3) | st.sampled_from([-0.0, 5e-324, 1e-300])
    points = np.array([[draw(near) for _ in range(3)] for _ in range(count)])
    std = np.array([draw(st.sampled_from([np.nan, 1e-4, 2.5e-7])) for _ in range(count)])
    turned = np.array(draw(st.permutations([1.0, 0.0, 0.0])))
    return SimpleNamespace(
        points_m=points,
        normals=np.tile(turned, (count, 1)),
        triangles=np.array([[0, 1, 2]]),
        lines=np.array([[0, count - 1]]),
        std_m=std,
        std_across_m=std,
        patch=np.zeros(count, int),
        touched_m=points[:1],
        touched_normal=turned[None],
        touched_normal_covariance=np.eye(3)[None],
        touched_std_m=std[:1],
        touched_force_N=np.ones(1),
        touched_frame=np.zeros(1, int),
        touched_patch=np.zeros(1, int),
        outlier=np.zeros(1, bool),
        compliance=SimpleNamespace(
            compliance_m_N=1.0, std_m_N=1.0, interval_N_m=np.array([1.0, np.inf]), reason="soft"
        ),
        notes=("a note",),
    )


@pytest.mark.parametrize(("suffix", "digits"), [("vtp", float), ("ply", float), ("glb", np.float32)])
@settings(max_examples=15, deadline=None, derandomize=True, database=None)
@given(surface=surfaces())
def test_objects(suffix: str, digits: type, surface: SimpleNamespace) -> None:
    """Points to the bit, in .glb as far as its four bytes reach; triangles, lines, and which deviations are known."""
    mesh = ObjectMesh.of(surface)
    write = {
        "vtp": lambda path: path.write_text(vtp_text(to_mesh(surface))),
        "ply": lambda path: path.write_bytes(ply_bytes(mesh)),
        "glb": lambda path: path.write_bytes(glb_bytes(mesh)),
    }[suffix]
    back = passed(f"object.{suffix}", write, read_object)
    assert same(back.points_m, surface.points_m.astype(digits))
    assert np.array_equal(back.normals, surface.normals)
    assert np.array_equal(back.triangles, surface.triangles)
    assert np.array_equal(back.lines, surface.lines)
    known = np.full(len(surface.std_m), np.nan) if back.std_m is None else back.std_m
    np.testing.assert_allclose(known, surface.std_m, rtol=1e-7)
