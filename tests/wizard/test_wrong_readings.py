"""Tables of what was read with the pictures: what is wrong in them is named before a picture is taken with it."""

from __future__ import annotations

from pathlib import Path

import pytest

from .small_session import call
from .tiny_wizard import Tiny, expect_refused, finished, tiny

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


def test_mended_it_goes_on(tiny: Tiny, tmp_path: Path) -> None:
    """What was taken before the wrong row stays, and the mended table ends the step."""
    table = tmp_path / "readings.csv"
    table.write_text(FREE + "1.png,0,0,0.001\n2.png,0,20,0.002\n")
    expect_refused(tiny, call(tiny.session, "--redo", "noload", "--noload-readings", table), "2.png")
    table.write_text(FREE + "1.png,0,0,0.001\n2.png,0,0.2,0.002\n")
    code, said = call(tiny.session)
    assert code == 0, said
    assert "took      1.png" not in said
    rows = (tiny.session / "noload" / "noload.csv").read_text().split()
    assert rows[1:] == ["0001.png,0.0,0.0,0.001", "0002.png,0.0,0.2,0.002"]
