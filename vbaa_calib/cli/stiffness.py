"""`vbaa stiffness TABLE.csv --load N --distance M`, or a photograph in the table's place."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import refuse_overwrite, sha256, write_json

from . import stiffness_photo

if TYPE_CHECKING:
    from vbaa_calib.calibrate.antenna.stiffness import BeamFit, DeflectionTable, StiffnessSolution


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "table", type=Path, help="CSV with the columns x_m,unloaded_y_m,loaded_y_m; or a photograph of the bent rod"
    )
    parser.add_argument(
        "--load",
        dest="force_N",
        type=float,
        metavar="N",
        help="in newtons, + along +y; along gravity in a photograph",
    )
    parser.add_argument(
        "--distance",
        dest="distance_m",
        type=float,
        metavar="M",
        help="clamp to load along the rod, in metres (photograph: default the tip)",
    )
    section = parser.add_mutually_exclusive_group()
    section.add_argument("--diameter", type=float, metavar="M", help="of a round rod, in metres: gives Young's modulus")
    section.add_argument(
        "--second-moment", type=float, metavar="M4", help="second moment of area in m^4: gives Young's modulus"
    )
    parser.add_argument(
        "--no-offset", action="store_true", help="the gauge showed 0 at the clamp both times: hold its offset at 0"
    )
    parser.add_argument(
        "--clamp-share",
        type=float,
        default=0.02,
        metavar="S",
        help="how far the clamp may turn (standard deviation), as a share of the slope at the load (default: 0.02)",
    )
    parser.add_argument("-o", "--output", type=Path, help="stiffness.json to write")
    stiffness_photo.configure(parser)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Read, solve, report; write stiffness.json if asked. Returns its numbers."""
    from vbaa_calib.calibrate.antenna.stiffness import read_deflections, solve_stiffness
    from vbaa_calib.core.images import SUFFIXES

    if args.table.suffix.lower() in SUFFIXES:
        return stiffness_photo.run(args)
    if args.force_N is None or args.distance_m is None:
        raise InputError(
            "a table needs --load N and --distance M", where=args.table, remedy="see vbaa stiffness --help"
        )
    if args.output:
        refuse_overwrite(args.output, args.force, [args.table])
    diameter, moment = args.diameter, args.second_moment
    if diameter is not None:
        if not 0.0 < diameter < args.distance_m:
            raise InputError(f"--diameter is {diameter:g}", remedy="give metres, less than the rod's length")
        moment = math.pi * diameter**4 / 64.0
    elif moment is not None and not 0.0 < moment < args.distance_m**4:
        raise InputError(f"--second-moment is {moment:g}", remedy="give m^4 (1 mm^4 is 1e-12): π d⁴/64, or b h³/12")
    if not 0.0 <= args.clamp_share <= 1.0:
        raise InputError(f"--clamp-share is {args.clamp_share:g}", remedy="give a share from 0 (rigid) to 1")
    table = read_deflections(args.table, args.force_N, args.distance_m)
    try:
        solution = solve_stiffness(
            table, args.force_N, args.distance_m, offset=not args.no_offset, clamp_share_std=args.clamp_share
        )
    except InputError as error:
        raise InputError(error.what, where=args.table, remedy=error.remedy) from None
    document = _stiffness_document(table, solution, args.force_N, args.distance_m, moment)
    document |= {"inputs_sha256": {args.table.name: sha256(args.table)}, "command": list(args.argv)}
    _report(document)
    if args.output:
        write_json(args.output, document, args.force)
        say(f"wrote {args.output}")
        return {"output": str(args.output), **document}
    return document


def _stiffness_document(
    table: DeflectionTable, solution: StiffnessSolution, force_N: float, distance_m: float, moment_m4: float | None
) -> dict[str, Any]:
    def fields(of: object, *names: str) -> dict[str, Any]:
        return {name: getattr(of, name) for name in names}

    fit, rows = solution.fit, zip(table.x_m, table.deflection_m, solution.residuals_m, strict=True)
    document: dict[str, Any] = {
        "schema": "vbaa.stiffness/1",
        "force_N": force_N,
        "distance_m": distance_m,
        "readings": len(table.x_m),
        "stiffness_Nm2": fit.stiffness_Nm2,
        "stiffness_std_Nm2": fit.std_Nm2,
        "stiffness_interval_95_Nm2": list(solution.interval_Nm2),
        **fields(solution, "clamp_share_std", "clamp_std_Nm2"),
        **fields(fit, "offset_m", "offset_std_m"),
        "offset_free": solution.offset_free,
        "rms_m": fit.rms_m,
        "residual_correlation": solution.correlation,
        **fields(solution, "correlation_length_m", "effective_readings", "model", "model_reason", "slope_at_load"),
        "linear_bias": solution.linear_bias,
        "rows": [
            {"x_m": float(x), "deflection_m": float(y), "residual_m": float(r), "outlier": index in solution.outliers}
            for index, (x, y, r) in enumerate(rows)
        ],
        "alternatives": [],
    }
    other = "the gauge's offset held at 0" if solution.offset_free else "the gauge's offset free"
    for assumption, one in ((other, solution.other_offset), ("the clamp free to turn", solution.free_clamp)):
        if one is not None:
            row = {"assumption": assumption, "stiffness_Nm2": one.stiffness_Nm2, "stiffness_std_Nm2": one.std_Nm2}
            row |= fields(one, "offset_m", "clamp_rotation_rad", "rms_m")
            if moment_m4 is not None:
                row["youngs_modulus_Pa"] = one.stiffness_Nm2 / moment_m4
            document["alternatives"].append(row)
    if moment_m4 is not None:
        document["second_moment_m4"] = moment_m4
        for name in ("", "_std", "_interval_95"):
            value = document[f"stiffness{name}_Nm2"]
            scaled = [bound / moment_m4 for bound in value] if isinstance(value, list) else value / moment_m4
            document[f"youngs_modulus{name}_Pa"] = scaled
    document["not_separated"] = _not_separated(solution)
    document["warnings"] = _warnings(table, solution, document)
    return document


def _not_separated(solution: StiffnessSolution) -> list[str]:
    fit, other, free = solution.fit, solution.other_offset, solution.free_clamp
    state = "held at 0" if solution.offset_free else "free"
    sentences = [
        f"the gauge's offset: with it {state}, EI would be {_percent(other, fit)}, at {1e3 * other.rms_m:.3g} mm rms "
        f"against {1e3 * fit.rms_m:.3g}",
    ]
    if free is not None:
        sentences.append(
            f"a clamp that turns from a softer rod: if the clamp may turn as it likes, it would turn by "
            f"{1e3 * free.clamp_rotation_rad:.3g} mrad and EI would be {_percent(free, fit)} (± "
            f"{100 * free.std_Nm2 / fit.stiffness_Nm2:.3g} %), at {1e3 * free.rms_m:.3g} mm rms; the better fit is no "
            "proof of it, for the turning takes up any other error that grows along the rod"
        )
    exact = "force and distance: both are taken as exact; an error of 1 % in the force is 1 % in EI, in the distance"
    return [*sentences, f"{exact} 1 to 1.5 %"]


def _percent(fit: BeamFit, reference: BeamFit) -> str:
    return f"{fit.stiffness_Nm2:.4g} N·m² ({100 * (fit.stiffness_Nm2 / reference.stiffness_Nm2 - 1):+.3g} %)"


def _warnings(table: DeflectionTable, solution: StiffnessSolution, document: dict[str, Any]) -> list[str]:
    warnings = [
        f"the reading at x = {table.x_m[index]:g} m is off by {1e3 * solution.residuals_m[index]:+.3g} mm, far from "
        "its neighbours: left out"
        for index in solution.outliers
    ]
    kept, free, fit = len(table.x_m) - len(solution.outliers), solution.free_clamp, solution.fit
    low, high = (1e8, 1.3e12)
    modulus = document.get("youngs_modulus_Pa", low + 1.0)
    sagging = float(table.unloaded_y_m.max() - table.unloaded_y_m.min()) > 0.2 * float(abs(table.deflection_m).max())
    few = f"{kept} readings are too few to see slips among them or whether neighbours err together"
    together = (
        f"neighbouring residuals err together (correlation {solution.correlation:.2f}): the {kept} readings fix EI "
    )
    together += f"no better than {solution.effective_readings:.1f} independent ones would; the interval allows for it"
    turns = "the readings suggest a clamp that turns, or a clamp that is not where x = 0 is: check it"
    inner = "no reading in the outer 40 % between clamp and load, where most of the bending shows"
    sag = "the unloaded rod is not straight: with large deflections its sag does not cancel"
    solid = f"Young's modulus {modulus / 1e9:.3g} GPa is that of no solid: check the units and the section"
    rules = (
        (kept < 8, few),
        (solution.effective_readings < 0.5 * kept, together),
        (free is not None and abs(free.stiffness_Nm2 - fit.stiffness_Nm2) > 2.0 * free.std_Nm2, turns),
        (table.x_m[-1] < 0.6 * document["distance_m"], inner),
        (solution.model == "elastica" and sagging, sag),
        (not low < modulus < high, solid),
    )
    return warnings + [words for holds, words in rules if holds]


def _report(document: dict[str, Any]) -> None:
    low, high = document["stiffness_interval_95_Nm2"]
    value, std = document["stiffness_Nm2"], document["stiffness_std_Nm2"]
    say(f"EI         {value:.5g} ± {std:.2g} N·m², 95 % {low:.5g} … {high:.5g}")
    if "youngs_modulus_Pa" in document:
        low, high = (bound / 1e9 for bound in document["youngs_modulus_interval_95_Pa"])
        modulus, std = document["youngs_modulus_Pa"] / 1e9, document["youngs_modulus_std_Pa"] / 1e9
        say(f"E          {modulus:.4g} ± {std:.2g} GPa, 95 % {low:.4g} … {high:.4g}")
    say(f"model      {document['model']}: {document['model_reason']}")
    offset = f"offset {1e3 * document['offset_m']:.3g} ± {1e3 * document['offset_std_m']:.2g} mm"
    if not document["offset_free"]:
        offset = "offset held at 0"
    say(f"residuals  {1e3 * document['rms_m']:.3g} mm rms, {offset}")
    say(
        f"readings   {document['readings']}, equivalent to {document['effective_readings']:.1f} independent ones; "
        f"neighbouring residuals correlate by {document['residual_correlation']:.2f}"
    )
    for sentence in document["not_separated"]:
        say(f"unknown    {sentence}")
    for warning in document["warnings"]:
        say(f"warning    {warning}")
