"""The README's table of the demo: what it says, and what it has to say of a demo that was run."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np

from estimator.felt import Felt, feel
from estimator.table import read_contacts
from vbaa_calib.cli.demo import SCENES
from vbaa_calib.rig import Rig

README = Path(__file__).parents[1] / "README.md"


def as_units(cell: str) -> tuple[str, list[float]]:
    """The words of a cell, and its numbers in units of their last digits."""
    numbers = re.findall(r"\d+(?:\.\d+)?", cell)
    units = [float(each) * 10 ** len(each.partition(".")[2]) for each in numbers]
    return re.sub(r"\d+(?:\.\d+)?", "#", cell), units


def table_in_readme() -> dict[str, dict[str, str]]:
    """Scene → row's name → cell, of the rows that a run decides and a machine's speed does not."""
    lines = README.read_text(encoding="utf-8").splitlines()
    start = next(index for index, line in enumerate(lines) if line.startswith("| root mean square error | demo"))
    rows = {}
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        name, *cells = (cell.strip() for cell in line.strip("|").split("|"))
        if not name.startswith("seconds"):
            rows[re.sub(r" \(.*\)|, N/m.*", "", name)] = [re.sub(r"^not told: .*", "not told", cell) for cell in cells]
    return {scene: {name: cells[index] for name, cells in rows.items()} for index, scene in enumerate(SCENES)}


def table_of(demo: Path) -> dict[str, str]:
    """The same of a finished demo's folder, to the digits that the README prints."""
    summary = json.loads((demo / "summary.json").read_text(encoding="utf-8"))
    felt = feel(read_contacts(demo / "contacts.csv"), Rig.load(demo / "rig.json"))
    return {
        "contact point": f"{1e3 * summary['contact_point_rmse_m']:.2f} mm",
        "contact distance": f"{1e3 * summary['distance_rmse_m']:.2f} mm",
        "force": f"{100 * summary['force_rmse_relative']:.2f} %",
        "force direction": f"{np.degrees(summary['direction_rmse_rad']):.2f}°",
        "stiffness EI": f"{100 * summary['stiffness_relative_error']:.3f} %",
        "focal length": f"{100 * summary['focal_relative_error']:.3f} %",
        "camera position": f"{1e3 * summary['camera_position_error_m']:.2f} mm",
        "error² over predicted variance": f"{summary['nees']:.1f}",
        "frames right, of all": f"{summary['frames_ok']} of {summary['frames']}",
        "object: μ": _friction(felt),
        "object: stiffness": _stiffness(felt),
    }


def _friction(felt: Felt) -> str:
    if felt.friction.told:
        return f"{felt.friction.mu:.3f} ± {felt.friction.std:.3f}"
    return "not told"


def _stiffness(felt: Felt) -> str:
    soft = felt.compliance
    low, high = soft.interval_N_m
    return f"{soft.stiffness_N_m:.0f}, 95 %: {low:.0f} to {high:.0f}" if soft.told else f"stiffer than {low:.0f}"
