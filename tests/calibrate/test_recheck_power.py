"""How often one picture of the board and one of the free antenna find what has changed, over drawn rigs and pictures.

The table of benchmarks/limits.md: `pytest -m slow -s tests/calibrate/test_recheck_power.py` prints it.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from vbaa_calib.calibrate.check.assessment import NewPictures, assess
from vbaa_calib.core.errors import InputError
from vbaa_calib.simulate.scene.scene import SceneSpec

from .checked_rigs import (
    leaning,
    one_picture_each,
    rig_document,
    scene,
    with_antenna,
    with_board,
    with_camera_moved,
    with_clamp_turned,
    with_jig_shifted,
    with_lens,
    with_sensor,
    with_wire_bent,
)

TIP_BOW_PER_M = 2e-3 / 0.24**2
"""Curvature that takes the tip of the wire 1 mm away."""


def turned(angle_rad: float, old: SceneSpec) -> SceneSpec:
    """The camera turned about the axis that its picture's rows run along: it nods."""
    return with_camera_moved(old, np.concatenate([angle_rad * old.T_antenna_camera.rotation[:, 0], np.zeros(3)]))


def moved(shift_m: float, axis: int, old: SceneSpec) -> SceneSpec:
    """The camera moved along one of its own axes: 0 across, 2 along its line of sight."""
    return with_camera_moved(old, np.concatenate([np.zeros(3), shift_m * old.T_antenna_camera.rotation[:, axis]]))


SCENES: dict[str, Callable[[], SceneSpec]] = {"upright": scene, "leaning 30°": leaning}
CHANGES: dict[str, Callable[[SceneSpec], SceneSpec]] = {
    "nothing": lambda old: old,
    **{f"camera turned by {angle} mrad": partial(turned, 1e-3 * angle) for angle in (1, 2, 5)},
    **{f"camera moved {shift} mm across": partial(moved, 1e-3 * shift, 0) for shift in (0.2, 0.5, 1)},
    **{f"camera moved {shift} mm along its line of sight": partial(moved, 1e-3 * shift, 2) for shift in (0.2, 0.5, 1)},
    "focal length +0.2 %": lambda old: with_lens(old, 1.002),
    "focal length +0.5 %": lambda old: with_lens(old, 1.005),
    "wire bent, 1 mm at the tip, in plane C": lambda old: with_wire_bent(old, TIP_BOW_PER_M),
    "wire bent, 1 mm at the tip, out of plane C": lambda old: with_wire_bent(old, 0.0, TIP_BOW_PER_M),
    "clamp turned by 5 mrad in plane C": lambda old: with_clamp_turned(old, 5e-3),
    "clamp turned by 5 mrad out of plane C": lambda old: with_clamp_turned(old, 0.0, 5e-3),
    "sensor's offset +0.05 mN·m": lambda old: with_sensor(old, offset_Nm=5e-5),
    "sensor's offset +0.1 mN·m": lambda old: with_sensor(old, offset_Nm=1e-4),
    "sensor's gain +5 %": lambda old: with_sensor(old, gain=1.05),
    "wire of 1.0 mm for 0.8 mm": lambda old: with_antenna(old, diameter=1.25),
    "wire 5 % shorter": lambda old: with_antenna(old, length=0.95),
    "board printed 0.5 % larger": lambda old: with_board(old, scale=1.005),
    "board of another dictionary": lambda old: with_board(old, dictionary="DICT_5X5_100"),
    "board 0.5 mm out of its jig, sideways": lambda old: with_jig_shifted(old, (5e-4, 0.0, 0.0)),
}


def outcome(change: Callable[[SceneSpec], SceneSpec], name: str, seed: int, folder: Path) -> dict[str, str]:
    """Levels by finding for one drawn rig and one pair of pictures; `refused` where a picture was."""
    old = replace(SCENES[name](), seed=1000 + seed)
    (folder / "rig.json").write_text(json.dumps(rig_document(old, seed)))
    pictures = one_picture_each(change(old), folder)
    try:
        found = assess(folder / "rig.json", None, pictures)
    except InputError as error:
        return {"verdict": "refused", "refused": "refused: " + error.what}
    return {one.name: one.level for one in found.session.findings} | {"verdict": found.verdict}


def row(what: str, name: str, draws: int, folder: Path) -> tuple[Counter[str], Counter[str]]:
    """How often each verdict was given, and each finding was not `holds`."""
    verdicts: Counter[str] = Counter()
    blamed: Counter[str] = Counter()
    for seed in range(draws):
        found = outcome(CHANGES[what], name, seed, folder)
        verdicts[found.pop("verdict")] += 1
        blamed.update(key for key, level in found.items() if level not in ("holds", "not given"))
    return verdicts, blamed


def table_line(what: str, name: str, draws: int, found: tuple[Counter[str], Counter[str]]) -> str:
    """A line of benchmarks/limits.md's table."""
    verdicts, blamed = found
    levels = (verdicts["holds"], verdicts["look at"], verdicts["does not hold"], verdicts["refused"])
    where = ", ".join(f"{key} {count}" for key, count in blamed.most_common())
    return f"| {name} | {what} | {draws} | {' | '.join(map(str, levels))} | {where} |"


def test_what_a_picture_along_the_line_of_sight_cannot_show_is_not_claimed(tmp_path: Path) -> None:
    # an upright camera looks along the bow: rows of the table of benchmarks/limits.md that stay empty
    found = outcome(CHANGES["wire bent, 1 mm at the tip, out of plane C"], "upright", 0, tmp_path)
    assert found["verdict"] == "holds"
    said = assess(tmp_path / "rig.json", None, NewPictures(None, tmp_path / "free.png"))
    assert "along the line of sight is not visible" in said.to_dict()["session_findings"][3]["words"]
    assert found["stiffness"] == found["sensor_gain"] == "not given"


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_the_table_of_the_manual(name: str, tmp_path: Path) -> None:
    """Prints the table of benchmarks/limits.md, and holds its claims: no false alarm, gross changes found."""
    for what in CHANGES:
        draws = 60 if what == "nothing" else 20
        found = row(what, name, draws, tmp_path)
        print(table_line(what, name, draws, found))
        if what == "nothing":
            assert found[0]["holds"] >= 58
        if what.startswith(("camera turned by 5", "camera moved 1 mm", "board of another")):
            assert found[0]["holds"] == 0
