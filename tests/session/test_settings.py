"""session.yaml: what is read of it, and what is refused by name; more of the latter: tests/hostile."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from vbaa_calib.session import Still, load_session

from .files import GOOD, attempt, changed, nodes, write


class TestSessionFile:
    def test_what_is_read(self, root: Path) -> None:
        session = load_session(root)
        assert session.board.squares_x == 9
        assert session.antenna.stiffness_Nm2 == pytest.approx(193e9 * math.pi * 0.0008**4 / 64, rel=1e-15)
        assert session.antenna.mass_per_length_kg_m == pytest.approx(7900 * math.pi * 0.0008**2 / 4, rel=1e-15)
        np.testing.assert_array_equal(session.gravity_world_m_s2, [0, 0, -9.80665])
        np.testing.assert_allclose(session.kinematics.T_actuator_antenna.translation_m, [0.1, 0.2, 0.3])
        np.testing.assert_array_equal(session.kinematics.position_world_m, [0, 0, 0.15])
        assert session.moment_std_Nm == 2e-5
        # the jig holds the back; the printed face is one thickness nearer, along the board's −z
        normal = session.T_antenna_board.rotation[:, 2]
        np.testing.assert_allclose(normal, [2 * 0.6 * 0.8, 0, 0.8**2 - 0.6**2], atol=1e-15)
        np.testing.assert_allclose(session.T_antenna_board.translation_m, [0.1, 0.2, 0.3] - 0.002 * normal)

    def test_gravity_turns_with_the_joints(self, root: Path) -> None:
        write(root, changed("kinematics"))
        session, angle = load_session(root), 0.3
        pulls = session.gravity_antenna([Still(None, 0.7, angle, 0.0), Still(None, 0.0, 0.0, 0.0)])
        expected = -9.80665 * np.array([math.sin(angle), 0.0, math.cos(angle)])
        np.testing.assert_allclose(pulls, [expected, [0, 0, -9.80665]], atol=1e-12)

    def test_every_missing_key_is_named(self, root: Path) -> None:
        said = {}
        for keys in nodes(GOOD):
            if isinstance(keys[-1], str):
                write(root, changed(*keys, drop=True))
                said[".".join(map(str, keys))] = attempt(lambda: load_session(root))[1]
        assert all(f" {key} is missing" in words for key, words in said.items() if words and key != "schema")
        optional = {
            "moment_sensor",
            "jig",
            "kinematics",
            "kinematics.T_actuator_antenna",
            "kinematics.position_world_m",
        }
        optional |= {f"board.{key}" for key in ("type", "dictionary", "legacy_pattern", "thickness_m")}
        assert {key for key, words in said.items() if not words} == optional
