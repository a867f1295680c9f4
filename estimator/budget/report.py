"""The error budget in words, as a table and as plain data."""

from __future__ import annotations

from typing import Any

import numpy as np

from estimator.budget.budget import ADVISED, CAUSES, OWN, Budget, BudgetSettings, ResultBudget

RESULT_NAMES = {
    "distance_m": "distance l",
    "force_y_N": "force f_y",
    "force_z_N": "force f_z",
    "force_N": "lateral force",
    "point_m": "world point",
}
TABLES = ("distance_m", "force_y_N", "force_z_N", "point_m")
SCHEMA = "vbaa.budget/1"


def table(budget: Budget) -> str:
    """The budget of distance, force and point as a text table."""
    many = "contact" if budget.asked == 1 else "contacts"
    lines = [f"{len(budget.touches)} of {budget.asked} {many} would come with numbers; deviations are rms over them."]
    for name in TABLES:
        lines += ["", *_table(budget, name)]
    if budget.exact:
        lines += ["", "counted as exact: " + ", ".join(CAUSES[cause].name for cause in budget.exact)]
    return "\n".join(lines)


def advice(budget: Budget) -> list[str]:
    """Sentences on what to improve first and by how much: for distance, force and point, overall, and of the
    calibration."""
    lines = [f"{RESULT_NAMES[name]}: {_first(budget.results[name], name)}" for name in ADVISED]
    first, of_rig = budget.first, budget.first_of_rig
    gain, (name, _, remedy) = 100 * budget.gain(first), CAUSES[first]
    lines.append(
        f"No cause stands out: half of {name} would take {gain:.1f} % off."
        if gain < 100 * BudgetSettings.worthwhile
        else f"Improve first: {name}. Half of it takes {gain:.0f} % off, on average. To do so, {remedy}."
    )
    if len(budget.leads) > 1:
        listed = ", ".join(f"{CAUSES[cause].name} in {count}" for cause, count in budget.leads.items())
        lines.append(f"The largest part of the distance's error is {listed} of {len(budget.touches)} contacts.")
    if of_rig is not None and of_rig != first:
        lines.append(
            f"Of the calibration, {CAUSES[of_rig].name} first: half of it takes {100 * budget.gain(of_rig):.1f} % off, "
            f"on average. To do so, {CAUSES[of_rig].remedy}."
        )
    shares = {name: budget.results[name].in_common for name in ADVISED}
    shared = [
        f"{100 * share:.0f} % of the {RESULT_NAMES[name]}"
        for name, share in shares.items()
        if abs(share) > BudgetSettings.correlated
    ]
    if shared:
        listed = ", ".join(shared)
        lines.append(f"Errors of the calibration are correlated: {listed}'s variance has no one cause, and is divided.")
    return lines


def as_data(budget: Budget) -> dict[str, Any]:
    """The budget as plain data; standard deviations in m and N."""
    return {
        "contacts": len(budget.touches),
        "asked": budget.asked,
        "improve_first": {
            "cause": budget.first,
            "gain": budget.gain(budget.first),
            "remedy": CAUSES[budget.first].remedy,
            "of_calibration": budget.first_of_rig,
        },
        "results": {
            name: {
                "std": result.std,
                "common_std": result.common_std,
                "correlated_share": result.in_common,
                "improve_first": result.first,
                "causes": {
                    cause: {**vars(part), "of": "frame" if cause in OWN else "calibration"}
                    for cause, part in result.parts.items()
                },
            }
            for name, result in budget.results.items()
        },
        "exact": list(budget.exact),
        "advice": advice(budget),
        "notes": list(budget.notes),
    }


def _table(budget: Budget, name: str) -> list[str]:
    result, unit = budget.results[name], unit_of(name)
    head = (
        f"{RESULT_NAMES[name]}: {1e3 * result.std:.3g} {unit}; of that the calibration's, common to all frames, "
        f"{1e3 * result.common_std:.3g} {unit}"
    )
    lines = [head, f"  {'cause':<18}{'part ' + unit:>10}{'share %':>10}{'if halved':>11}{'if exact':>11}"]
    small = [
        part
        for part in result.parts.values()
        if max(part.share, 1.0 - part.if_exact / result.std) < BudgetSettings.small
    ]
    for cause, part in sorted(result.parts.items(), key=lambda item: -item[1].share):
        if part in small:
            continue
        numbers = (1e3 * part.std, 100 * part.share, 1e3 * part.if_halved, 1e3 * part.if_exact)
        lines.append(f"  {CAUSES[cause].name:<18}" + "{:>10.3g}{:>10.1f}{:>11.3g}{:>11.3g}".format(*numbers))
    if small:
        std, share = 1e3 * np.sqrt(sum(part.std**2 for part in small)), 100 * sum(part.share for part in small)
        lines.append(f"  {'another' if len(small) == 1 else f'{len(small)} others':<18}{std:>10.3g}{share:>10.1f}")
    return lines


def _first(result: ResultBudget, name: str) -> str:
    part, less, unit = result.parts[result.first], 100 * result.gain(result.first), unit_of(name)
    halved = f"Half of it would make {1e3 * part.if_halved:.3g} {unit} of {1e3 * result.std:.3g} ({less:.0f} % less)"
    return f"{CAUSES[result.first].name} first. {halved}; without it, {1e3 * part.if_exact:.3g} {unit} would be left."


def unit_of(name: str) -> str:
    """Unit of a result in the report: mm or mN."""
    return "mm" if name.endswith("_m") else "mN"
