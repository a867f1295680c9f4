"""The README's table of the demo: what it says, and what it has to say of a demo that was run."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.object.estimate import ObjectEstimate, estimate_object
from estimator.table.files import read_contacts
from vbaa_calib.rig import Rig
from viz.cli.demo import SCENES

NUMBER = r"\d+(?:\.\d+)?"
LEVEL = "95 %"
OF_GOAL, OF_DEVIATION = 0.002, 0.01
"""Parts of a goal, and of a standard deviation, by which the README may differ from a run."""
PAGE = Path(__file__).parents[1] / "docs" / "accuracy.md"


@dataclass(frozen=True)
class Cell:
    """What a run has to say: the words, and beside each number by how much the README may differ from it.

    `slack` is a part of what the number means, a goal or a standard deviation, in the number's own unit.
    """

    text: str
    slack: tuple[float, ...] = ()

    def agrees(self, readme: str) -> bool:
        """Whether a cell of the README says the same, to its own digits and the slack."""
        (words, numbers), (words_there, numbers_there) = parts(self.text), parts(readme)
        if words != words_there or len(numbers) != len(numbers_there):
            return False
        slack = self.slack or (0.0,) * len(numbers)
        return all(
            abs(float(one) - float(other)) <= room + 0.5 * digit(one) + 0.5 * digit(other)
            for one, other, room in zip(numbers, numbers_there, slack, strict=True)
        )


def parts(cell: str) -> tuple[str, list[str]]:
    """The words of a cell, and its numbers."""
    return re.sub(NUMBER, "#", cell), re.findall(NUMBER, cell)


def digit(number: str) -> float:
    """The last digit's unit, half of which is lost in printing; whole numbers count as exact."""
    places = len(number.partition(".")[2])
    return 10.0**-places if places else 0.0


def table_in_readme() -> dict[str, dict[str, str]]:
    """Scene → row's name → cell, of the rows that a run decides and a machine's speed does not."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    start = next(index for index, line in enumerate(lines) if line.startswith("| root mean square error | demo"))
    rows = {}
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        name, *cells = (cell.strip() for cell in line.strip("|").split("|"))
        if not name.startswith("seconds"):
            rows[re.sub(r" \(.*\)|, N/m.*", "", name)] = [re.sub(r"^not told: .*", "not told", cell) for cell in cells]
    return {scene: {name: cells[index] for name, cells in rows.items()} for index, scene in enumerate(SCENES)}


def table_of(demo: Path) -> dict[str, Cell]:
    """The same of a finished demo's folder, to more digits than the README prints."""
    summary = json.loads((demo / "summary.json").read_text(encoding="utf-8"))
    rig = Rig.load(demo / "rig.json")
    felt = estimate_object(read_contacts(demo / "contacts.csv"), rig)
    position_m = np.linalg.norm([rig.std(name) for name in ("camera_x_m", "camera_y_m", "camera_z_m")])
    focal = rig.std("fx") / rig.camera.matrix[0, 0]
    goals = OF_GOAL * np.array([1.5, 4.8, 8.0, 4.0])
    known = OF_DEVIATION * np.array([100 * rig.std("log_stiffness_Nm2"), 100 * focal, 1e3 * position_m])
    errors = (
        ("contact point", 1e3 * summary["contact_point_rmse_m"], " mm", goals[0]),
        ("contact distance", 1e3 * summary["distance_rmse_m"], " mm", goals[1]),
        ("force", 100 * summary["force_rmse_relative"], " %", goals[2]),
        ("force direction", np.degrees(summary["direction_rmse_rad"]), "°", goals[3]),
        ("stiffness EI", 100 * summary["stiffness_relative_error"], " %", known[0]),
        ("focal length", 100 * summary["focal_relative_error"], " %", known[1]),
        ("camera position", 1e3 * summary["camera_position_error_m"], " mm", known[2]),
        ("error² over predicted variance", summary["nees"], "", OF_GOAL),
    )
    return {name: Cell(f"{value:.6f}{unit}", (slack,)) for name, value, unit, slack in errors} | {
        "frames right, of all": Cell(f"{summary['frames_ok']} of {summary['frames']}"),
        "object: μ": _friction(felt),
        "object: stiffness": _stiffness(felt),
    }


def _friction(felt: ObjectEstimate) -> Cell:
    if felt.friction.determined:
        slack = OF_DEVIATION * felt.friction.std
        return Cell(f"{felt.friction.mu:.6f} ± {felt.friction.std:.6f}", (slack, slack))
    return Cell("not told")


def _stiffness(felt: ObjectEstimate) -> Cell:
    soft = felt.compliance
    low, high = soft.interval_N_m
    if not soft.determined:
        return Cell(f"stiffer than {low:.4f}", (0.5 + OF_DEVIATION * low,))
    slack = 0.5 + OF_DEVIATION * (high - low) / 4
    return Cell(f"{soft.stiffness_N_m:.4f}, {LEVEL}: {low:.4f} to {high:.4f}", (slack, 0.0, slack, slack))
