"""What is read with a picture means the same in whichever unit; what is wrong in a table is named before it is used."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from vbaa_calib.wizard.questions import UNITS, complete, in_si
from vbaa_calib.wizard.store import Store

from .small_session import Tiny, call, expect_refused, finished, tiny

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


__all__ = ["finished", "tiny"]

FREE = "image,pan_rad,tilt_rad,moment_Nm\n"
LOAD = "image,pan_deg,tilt_deg,moment_mNm,distance_mm,mass_g,force_y_mN,force_z_mN\n"
TABLES: dict[str, tuple[str, str | bytes, tuple[str, ...]]] = {
    "no moment": ("noload", "image,pan_rad,tilt_rad\n1.png,0,0\n", ("moment_Nm is missing", "moment_mNm")),
    "a picture without row": (
        "noload",
        FREE + "1.png,0,0,0\n",
        ("2.png", "readings of the picture", "noload-readings"),
    ),
    "a picture twice": ("noload", FREE + "1.png,0,0,0\n1.png,0,0,0\n", ("line 3", "1.png stands twice")),
    "decimal comma": ("noload", FREE + '1.png,0,"0,3",0\n', ("line 2", "the decimal sign is a point")),
    "degrees": ("noload", FREE + "1.png,0,20,0\n2.png,0,0,0\n", ("1.png", "more than a turn", "degrees?")),
    "empty cell": ("noload", FREE + "1.png,,0,0\n2.png,0,0,0\n", ("1.png", "pan_rad is missing")),
    "mass and force": ("loads", LOAD + "1.png,0,0,1,100,5,0,-49\n", ("1.png", "both mass and force")),
    "neither": ("loads", LOAD + "1.png,0,0,1,100,,,\n", ("1.png", "neither a mass nor a force", "mass_g")),
    "beyond the tip": ("loads", LOAD + "1.png,0,0,1,300,5,,\n", ("1.png", "distance_m is 0.3", "0.24 m long")),
    "along the antenna": ("loads", LOAD + "1.png,0,90,1,100,5,,\n", ("1.png", "of the weight pull along", "level")),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_table(name: str, tiny: Tiny, tmp_path: Path) -> None:
    step, content, words = TABLES[name]
    table = tmp_path / "readings.csv"
    table.write_bytes(content if isinstance(content, bytes) else content.encode())
    outcome = call(tiny.session, "--redo", step, f"--{step}-readings", table)
    expect_refused(tiny, outcome, *words)


def test_a_further_camera_has_the_answers_of_the_first(tiny: Tiny) -> None:
    """Board, jig, antenna and loads, but not where its pictures come from, which is asked for."""
    code, said = call(tiny.session, "--another-camera", "left of it")
    assert (code, "its own name" in said) == (2, True)
    code, said = call(tiny.session, "--another-camera", "right")
    assert (code, "is not answered" in said) == (2, True), said
    with Store(tiny.session / "cameras" / "right") as own:
        kept = own.journal.answers
    assert kept["jig_translation_mm"] == [28, 61, -9]
    assert kept.get("source") != str(tiny.source)
