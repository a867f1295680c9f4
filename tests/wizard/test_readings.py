"""What is read with a picture means the same in whichever unit it is given."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from vbaa_calib.wizard.readings import UNITS, ReadingsTable, complete, in_si, read_table, table_of

DOWN = np.array([0.0, 0.0, -9.80665])


@pytest.mark.parametrize("names", UNITS.values(), ids=UNITS)
def test_units_agree(names: dict[str, float]) -> None:
    """A turn is 360 degrees, a metre 1000 mm: the same quantity in each unit gives the same number in SI."""
    per_si = {"rad": 1.0, "deg": 180 / math.pi, "m": 1.0, "mm": 1e3, "Nm": 1.0, "mNm": 1e3, "kg": 1.0, "g": 1e3}
    per_si |= {"N": 1.0, "mN": 1e3, "s": 1.0}
    first = next(iter(names))
    for name in names:
        [(key, value)] = in_si({name: 0.25 * per_si[name.rpartition("_")[2]]}, None).items()
        assert key == first
        assert value == pytest.approx(0.25, rel=1e-15)


def test_a_mass_is_its_weight() -> None:
    """Whatever way gravity lies across the antenna; the part along it, if small, is not in the table."""
    common = {"pan_deg": 0, "tilt_deg": 0, "moment_mNm": 3, "distance_mm": 200}
    rng = np.random.default_rng(2)
    for angle in rng.uniform(0, 2 * np.pi, 10):
        gravity = 9.8 * np.array([0.015, np.cos(angle), np.sin(angle)])
        by_mass = complete("loads", common | {"mass_g": 20}, gravity, 0.24, None)
        forces = {"force_y_mN": 20 * gravity[1], "force_z_N": 0.02 * gravity[2]}
        by_force = complete("loads", common | forces, DOWN, 0.24, None)
        assert [by_mass[k] for k in ("force_y_N", "force_z_N")] == pytest.approx(
            [by_force[k] for k in by_mass if "force" in k]
        )
        assert by_mass["distance_m"] == pytest.approx(0.2)


def test_rows_by_name_and_in_order(tmp_path: Path) -> None:
    rows = [{"pan_deg": 1}, {"image": "folder/b.png", "pan_deg": 2}, {"pan_deg": 3}]
    given = table_of(rows, "answers")
    assert [given.of(name, taken) for name, taken in (("a.png", 0), ("b.png", 1), ("c.png", 1), ("d.png", 2))] == [
        {"pan_deg": 1},
        {"pan_deg": 2},
        {"pan_deg": 3},
        None,
    ]
    (tmp_path / "t.csv").write_text("image,remark,pan_deg\nsub/a.png,good,1\n\nb.png,,2\n")
    assert read_table(tmp_path / "t.csv").of("a.png", 7) == {"pan_deg": "1"}
    assert ReadingsTable().of("a.png", 0) is None
