"""The table of materials: each is itself by its own numbers, and what it cannot be is not named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from vbaa_calib.antenna.materials import MATERIALS, _materials_near
from vbaa_calib.core.files import read_yaml
from vbaa_calib.core.models import json_schema
from vbaa_calib.session import load_session
from vbaa_calib.session.settings import SessionFile

from .files import changed, complaint, write


@pytest.mark.parametrize("name", MATERIALS)
def test_a_material_is_named_first_by_its_usual_numbers(name: str) -> None:
    one = MATERIALS[name]
    assert _materials_near(one.youngs_modulus_Pa)[0] == name
    assert _materials_near(one.youngs_modulus_Pa, one.density_kg_m3)[0] == name
    assert one.has_modulus(one.youngs_modulus_Pa)
    assert one.has_density(one.density_kg_m3)


def test_exactly_those_are_named_that_can_have_the_modulus() -> None:
    rng = np.random.default_rng(5)
    for modulus_Pa in 10 ** rng.uniform(8.0, 12.0, 200):
        within = {name for name, one in MATERIALS.items() if one.has_modulus(modulus_Pa)}
        assert set(_materials_near(modulus_Pa)) == within
        for density in 10 ** rng.uniform(2.9, 4.3, 5):
            assert set(_materials_near(modulus_Pa, density)) <= within


@pytest.mark.parametrize(("typed", "meant"), [("stainless steel", "nitinol"), ("stainless steel", "nylon")])
def test_materials_that_are_taken_for_each_other_share_no_modulus(typed: str, meant: str) -> None:
    low, high = MATERIALS[meant].modulus_range_Pa
    assert not {typed} & {name for modulus in np.geomspace(low, high, 20) for name in _materials_near(modulus)}


@pytest.mark.parametrize("name", MATERIALS)
def test_a_session_that_names_its_material_needs_no_numbers(root: Path, name: str) -> None:
    """Typed numbers win, and only what the material cannot be is doubted, with a material that can."""
    one = MATERIALS[name]
    size = {"length_m": 0.24, "diameter_m": 0.0008}
    write(root, changed("antenna", to=size | {"material": name.upper()}))
    antenna = load_session(root).antenna
    assert (antenna.youngs_modulus_Pa, antenna.density_kg_m3) == (one.youngs_modulus_Pa, one.density_kg_m3)
    assert antenna.material_doubts == []
    low, high = one.modulus_range_Pa
    for modulus_Pa, doubts in ((0.9 * low, 1), (1.02 * low, 0), (0.98 * high, 0), (1.1 * high, 1)):
        write(root, changed("antenna", to=size | {"material": name, "youngs_modulus_Pa": modulus_Pa}))
        antenna = load_session(root).antenna
        assert antenna.youngs_modulus_Pa == modulus_Pa
        found = antenna.material_doubts
        assert len(found) == doubts
        assert all(other in found[0].remedy for other in _materials_near(modulus_Pa)[:3] if found)


def test_another_word_needs_its_numbers(root: Path) -> None:
    write(root, changed("antenna", "material", to="whale bone"))
    assert load_session(root).antenna.material == "whale bone"
    write(root, changed("antenna", to={"length_m": 0.24, "diameter_m": 0.0008, "material": "whale bone"}))
    assert "youngs_modulus_Pa is missing" in complaint(lambda: load_session(root), root / "session.yaml")
    schema, jsonschema = json_schema(SessionFile, "session"), pytest.importorskip("jsonschema")
    for file, right in ((changed("antenna", "material", to="bone"), True), (read_yaml(root / "session.yaml"), False)):
        assert jsonschema.Draft202012Validator(schema).is_valid(file) == right
