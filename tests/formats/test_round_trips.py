"""Every file of ours: what is written is what is read, to the last bit, with numbers as extreme as a file may hold.

Where a file holds fewer digits by design (contacts.csv: nine), the second pass is the same as the first, byte by byte.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from vbaa_calib.core.files import UniqueKeyDumper, read_json, read_yaml, write_json, write_text
from vbaa_calib.rig import Antenna, Rig
from vbaa_calib.wizard.store import AcceptedPicture, _Journal, _RefusedPicture, _StepRecord

from ..test_rig import make_rig

QUICK = settings(max_examples=40, deadline=None, derandomize=True, database=None)
ANY = st.floats(allow_nan=False, allow_infinity=False)
EXTREME = st.sampled_from(
    [0.0, -0.0, 5e-324, -5e-324, 2.2250738585072014e-308, 1.7976931348623157e308, 0.1 + 0.2, 1e22]
)
NUMBER = ANY | EXTREME
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
def test_json_and_yaml(data: dict[str, Any]) -> None:
    """YAML as the wizard writes session.yaml."""
    assert bits(passed("a.json", lambda path: write_json(path, data), read_json)) == bits(data)
    text = yaml.dump(data, Dumper=UniqueKeyDumper, sort_keys=False, default_flow_style=None, allow_unicode=True)
    assert bits(passed("a.yaml", lambda path: write_text(path, text), read_yaml)) == bits(data)


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


READINGS = st.fixed_dictionaries(dict.fromkeys(("pan_rad", "tilt_rad", "moment_Nm"), NUMBER))


@QUICK
@given(
    readings=st.lists(READINGS, max_size=3),
    why=WORD,
    length=st.floats(1, 1e4),
    turn=st.lists(st.floats(-180, 180) | st.just(5e-324), min_size=3, max_size=3),
)
def test_the_wizards_journal(readings: list[dict[str, float]], why: str, length: float, turn: list[float]) -> None:
    taken = tuple(
        AcceptedPicture(file=f"noload/{k}.png", source=why, sha256="ab", readings=one) for k, one in enumerate(readings)
    )
    refused = _RefusedPicture(source=why, sha256="cd", why=why)
    journal = _Journal(
        answers={"antenna_length_mm": length, "jig_turn_deg": turn, "source": "a folder"},
        steps={"noload": _StepRecord(taken=taken, left=(refused,), closed="by hand")},
    )
    back = passed("wizard.json", lambda path: write_json(path, journal.to_dict()), _Journal.read)
    assert bits(back.to_dict()) == bits(journal.to_dict())
