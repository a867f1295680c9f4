"""`vbaa stiffness TABLE.csv --load N --distance M`, or with a photograph in place of the table."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vbaa_calib.core.console import say
from vbaa_calib.core.csv_rows import csv_text
from vbaa_calib.core.errors import InputError, about
from vbaa_calib.core.files import refuse_outputs, refuse_overwrite, replacing, sha256, write_json, write_text

if TYPE_CHECKING:
    from vbaa_calib.calibrate.antenna.stiffness import BeamFit, DeflectionTable, StiffnessSolution
    from vbaa_calib.calibrate.photo.centreline import RodLine, RodSearch
    from vbaa_calib.calibrate.photo.stiffness import PhotoSetting, PhotoStiffness
    from vbaa_calib.detect.drawing.canvas import Canvas


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "table", type=Path, help="CSV with the columns x_m,unloaded_y_m,loaded_y_m; or a photograph of the bent rod"
    )
    parser.add_argument(
        "--load", dest="force_N", type=float, metavar="N", help="in newtons, + along +y; along gravity in a photograph"
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
    _add_photo_options(parser)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Read a table, solve and report; write stiffness.json if asked. Returns its numbers."""
    from vbaa_calib.calibrate.antenna.stiffness import read_deflections, solve_stiffness
    from vbaa_calib.core.images import SUFFIXES

    if args.table.suffix.lower() in SUFFIXES:
        return _run_photo(args)
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
        solution = solve_stiffness(table, offset=not args.no_offset, clamp_share_std=args.clamp_share)
    except InputError as error:
        raise InputError(error.what, where=args.table, remedy=error.remedy) from None
    document = _stiffness_document(table, solution, moment)
    document |= {"inputs_sha256": {args.table.name: sha256(args.table)}, "command": list(args.argv)}
    _report(document)
    if args.output:
        write_json(args.output, document, args.force)
        say(f"wrote {args.output}")
        return {"output": str(args.output), **document}
    return document


def _stiffness_document(table: DeflectionTable, solution: StiffnessSolution, moment_m4: float | None) -> dict[str, Any]:
    def fields(of: object, *names: str) -> dict[str, Any]:
        return {name: getattr(of, name) for name in names}

    fit, rows = solution.fit, zip(table.x_m, table.deflection_m, solution.residuals_m, strict=True)
    document: dict[str, Any] = {
        "schema": "vbaa.stiffness/1",
        "force_N": table.force_N,
        "distance_m": table.distance_m,
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
        f"against {1e3 * fit.rms_m:.3g}"
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
    low, high = _SOLIDS_PA
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
    solid = f"Young's modulus {modulus / 1e9:.3g} GPa is that of no solid: {_units(modulus)}"
    rules = (
        (kept < 8, few),
        (solution.effective_readings < 0.5 * kept, together),
        (free is not None and abs(free.stiffness_Nm2 - fit.stiffness_Nm2) > 2.0 * free.std_Nm2, turns),
        (table.x_m[-1] < 0.6 * document["distance_m"], inner),
        (solution.model == "elastica" and sagging, sag),
        (not low < modulus < high, solid),
    )
    return warnings + [words for holds, words in rules if holds]


_SOLIDS_PA = 1e8, 1.3e12
"""Young's moduli between those of rubber and of diamond."""


def _units(modulus_Pa: float) -> str:
    """Mistakes of unit that would explain an impossible modulus (Pa), in words."""
    from vbaa_calib.antenna.materials import MATERIALS
    from vbaa_calib.diagnose.typed_loads import FORCE_UNITS, LENGTH_UNITS

    usual = [material.modulus_range_Pa for material in MATERIALS.values()]
    factors = [(f"the force {how}", factor) for how, factor in FORCE_UNITS[:3]]
    factors += [(f"the diameter {how}", factor**-4) for how, factor in LENGTH_UNITS[:3]]
    # of a force, deflections scale as it does; a section's moment is the diameter's fourth power
    likely = [how for how, factor in factors if any(low <= modulus_Pa * factor <= high for low, high in usual)]
    return f"is {', or '.join(likely)}?" if likely else "check the units and the section"


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


def _add_photo_options(parser: argparse.ArgumentParser) -> None:
    """Add the flags for a photograph."""
    pixels = "pixels count from the middle of the upper left one, upright as the camera's EXIF rotation says"
    group = parser.add_argument_group("photograph", pixels)
    group.add_argument("--length", type=float, metavar="M", help="of the rod from clamp to tip, in metres: the scale")
    group.add_argument("--marks", type=_pixel, nargs=2, metavar="U,V", help="two marks in the rod's plane: the scale")
    group.add_argument("--apart", type=float, metavar="M", help="how far apart these are, in metres")
    group.add_argument(
        "--weight", type=float, metavar="N/M", help="of the rod per length; without it or a load: EI per weight"
    )
    group.add_argument("--clamp", type=_pixel, metavar="U,V", help="where the rod is clamped (default: looked for)")
    group.add_argument("--tip", type=_pixel, metavar="U,V", help="where it ends (default: looked for)")
    group.add_argument(
        "--candidate", type=int, metavar="N", help="the line with this number in the picture of what may be the rod"
    )
    group.add_argument(
        "--unloaded", type=Path, metavar="PHOTO", help="the same without the load; lying flat if there is none"
    )
    group.add_argument("--straight", action="store_true", help="the free rod is known to be straight")
    group.add_argument(
        "--gravity-angle", type=float, default=0.0, metavar="DEG", help="from down the picture to its right"
    )
    group.add_argument(
        "--gravity-std", type=float, default=1.0, metavar="DEG", help="its standard deviation (default: 1)"
    )
    group.add_argument(
        "--tilt-std", type=float, default=3.0, metavar="DEG", help="of the rod's plane to the sensor (default: 3)"
    )
    group.add_argument("--scale-std", type=float, default=0.01, metavar="S", help="share of the scale (default: 0.01)")
    group.add_argument("--moments", type=Path, metavar="CSV", help="moment against curvature along the rod, to write")
    group.add_argument("--overlay", type=Path, metavar="PNG", help="the line over the photograph, to write")


def _pixel(text: str) -> np.ndarray:
    place = np.array([float(part) for part in text.split(",")])
    if place.shape != (2,) or not np.isfinite(place).all():
        raise ValueError
    return place


def _run_photo(args: argparse.Namespace) -> dict[str, Any]:
    """Find the rod in a photograph, solve and report; write the files that are asked for. Returns the numbers."""
    from vbaa_calib.calibrate.photo.centreline import search_rod
    from vbaa_calib.calibrate.photo.stiffness import solve_photo
    from vbaa_calib.core.images import read_picture

    photos = [args.table, *([args.unloaded] if args.unloaded else [])]
    outputs = [path for path in (args.output, args.moments, args.overlay) if path is not None]
    refuse_outputs(outputs, args.force, photos)
    setting = _setting(args)
    pictures = [read_picture(path, upright=True) for path in photos]  # gravity is down
    height, width = pictures[0].shape[:2]
    if args.marks is not None and not all(0 <= u < width and 0 <= v < height for u, v in args.marks):
        what, remedy = f"a mark lies outside this picture of {width}x{height} px", "give both as U,V in its pixels"
        raise InputError(what, where=args.table, remedy=remedy)
    lines: list[RodLine] = []
    searches: list[RodSearch] = []
    for path, picture in zip(photos, pictures, strict=True):
        with about(path):
            searches.append(search_rod(picture, args.clamp, None if lines else args.tip))
            try:
                lines.append(searches[-1].line(None if lines else args.candidate))
            except InputError as error:
                raise _with_candidates(error, args, path, picture, searches[-1]) from None
    if args.overlay:
        _draw(args.overlay, pictures[0], lines[0], args.force)
    with about(args.table):
        try:
            found = solve_photo(lines, setting)
        except InputError as error:
            raise _with_candidates(error, args, args.table, pictures[0], searches[0]) from None
    document = _document(found, setting, lines[0])
    document |= {"inputs_sha256": {path.name: sha256(path) for path in photos}, "command": list(args.argv)}
    _report_photo(document)
    if args.moments:
        write_text(args.moments, csv_text(document["moment_curvature"]), args.force)
    if args.output:
        write_json(args.output, document, args.force)
    for path in outputs:
        say(f"wrote {path}")
    return document


def _setting(args: argparse.Namespace) -> PhotoSetting:
    """The photograph's setting by the flags. Raises InputError for impossible values."""
    from vbaa_calib.calibrate.photo.stiffness import PhotoSetting

    if (args.length is None) == (args.marks is None):
        what = "the scale is given twice" if args.length else "nothing gives the scale"
        raise InputError(what, where=args.table, remedy="give --length M, or --marks U,V U,V with --apart M")
    limits = {"length": 100.0, "apart": 100.0, "weight": 1e4, "distance_m": 100.0}
    for name, most in limits.items():
        value = getattr(args, name)
        if value is not None and not 0.0 < value < most:
            raise InputError(
                f"--{name.removesuffix('_m')} is {value:g}", remedy=f"give SI units, more than 0, less than {most:g}"
            )
    if args.marks is not None and (args.apart is None or np.hypot(*(args.marks[1] - args.marks[0])) < 20.0):
        raise InputError("the marks give no scale", remedy="give two, at least 20 pixels apart, with --apart M")
    for name, most in (("gravity_angle", 360.0), ("gravity_std", 30.0), ("tilt_std", 30.0), ("scale_std", 0.3)):
        if not abs(value := getattr(args, name)) <= most or (name.endswith("std") and value < 0.0):
            raise InputError(f"--{name.replace('_', '-')} is {value:g}", remedy=f"give a number up to {most:g}")
    force = args.force_N or 0.0
    if args.force_N is not None and not (math.isfinite(force) and force != 0.0):
        raise InputError(f"the load is {force:g}", remedy="give newtons; leave --load out where there is none")
    return PhotoSetting(
        args.length,
        None if args.marks is None else np.array(args.marks),
        args.apart or 0.0,
        math.radians(args.gravity_angle),
        args.weight,
        force,
        args.distance_m,
        args.straight,
        args.scale_std,
        math.radians(args.gravity_std),
        math.radians(args.tilt_std),
    )


def _document(found: PhotoStiffness, setting: PhotoSetting, line: RodLine) -> dict[str, Any]:
    name, unit = ("stiffness_per_weight", "m3") if setting.per_weight else ("stiffness", "Nm2")
    value, (low, high) = (1.0 / found.inverse if found.determined else None), found.interval
    view = found.views[0]
    scale = view.middles_m[-1] / (1.0 - 0.5 / len(view.middles_m)) / line.length_px
    every = np.linspace(0, len(view.middles_m) - 1, 40).astype(int)
    places = view.at(view.middles_m) / scale + line.centre_px
    load = ["moment_m2" if setting.per_weight else "moment_Nm"]
    moments = np.column_stack([view.middles_m, places, view.moment, 2.0 * setting.scale_std * np.abs(view.moment)])
    table = np.column_stack([moments, found.curvature, found.curvature_std])[every]
    keys = ["s_m", "u_px", "v_px", *load, load[0].replace("_", "_std_"), "curvature_1_m", "curvature_std_1_m"]
    bow, bow_std = found.linear.moments_of(np.eye(2 - setting.straight)[-1:])
    single = found.linear.uncurled > 0.05
    return {
        "schema": "vbaa.stiffness-photo/1",
        f"{name}_{unit}": value,
        f"{name}_std_{unit}": value and value * found.inverse_std / found.inverse,
        f"{name}_interval_95_{unit}": [low, high if found.determined else None],
        "inverse": found.inverse,
        "inverse_std": found.inverse_std,
        "deviations": found.shares,
        "length_m": scale * line.length_px,
        "length_px": line.length_px,
        "m_per_px": scale,
        "width_px": line.width_px,
        "clamp_px": line.curve_px[0].tolist(),
        "tip_px": line.curve_px[-1].tolist(),
        "bow_1_m": None if setting.straight else float(bow[0]),
        "bow_std_1_m": None if setting.straight else float(bow_std[0]),
        "curl_std_1_m": found.linear.curl_std,
        "error_px": found.linear.error_std_m / scale,
        "single_stiffness_fits": single,
        "curved_p": found.curved_p,
        "moment_curvature": [dict(zip(keys, map(float, row), strict=True)) for row in table],
        "notes": _notes(found, setting, single, line),
    }


def _notes(found: PhotoStiffness, setting: PhotoSetting, single: bool, line: RodLine) -> list[str]:
    spread = found.linear.curl_std
    two = len(found.views) > 1
    cause = "the material is not linear" if two else "the rod has curl of its own, or the material is not linear"
    decide = "" if two else "; a photograph of the unloaded rod (--unloaded) would decide"
    apart = f"no single EI with one bow fits: curvature departs from it by {spread:.2g} 1/m: {cause}{decide}"
    curved = f"curvature is not proportional to the moment (p = {found.curved_p:.1g}): take moment_curvature, not EI"
    against = "the rod bends against its load: is the clamped end taken for the tip, or gravity not down?"
    bound = "as the rod hangs or lies, its line gives no upper bound of EI: clamp a shorter piece more nearly level"
    weight = "the rod's own weight is taken as nothing next to the load; --weight allows for it"
    (clamp_u, clamp_v), (tip_u, tip_v) = line.curve_px[0], line.curve_px[-1]
    higher = (
        f"the higher end, {clamp_u:.0f},{clamp_v:.0f}, is taken as clamped; else give --clamp {tip_u:.0f},{tip_v:.0f}"
    )
    # limp, curly rods reach a probability of 0.01 in 1 of 20
    rules = (
        (line.clamp_supposed, higher),
        (not found.determined, bound if found.interval[0] else against),
        (not single, apart),
        (found.curved_p < 1e-3, curved),
        (setting.load_N != 0.0 and setting.weight_N_m is None, weight),
    )
    unseen = "lens distortion is taken as nothing, load and weight as exact; the clamp's direction is not used"
    return [words for holds, words in rules if holds] + [unseen]


def _report_photo(document: dict[str, Any]) -> None:
    name, unit = ("stiffness", "N·m²") if "stiffness_Nm2" in document else ("stiffness_per_weight", "m³, per weight")
    suffix = "Nm2" if unit == "N·m²" else "m3"
    value, (low, high) = document[f"{name}_{suffix}"], document[f"{name}_interval_95_{suffix}"]
    if not low:
        say("EI         not determined")
    elif value is None:
        say(f"EI         more than {low:.3g} {unit} (97.5 %); the line determines no more")
    else:
        std = document[f"{name}_std_{suffix}"]
        say(f"EI         {value:.4g} ± {std:.2g} {unit}, 95 % {low:.3g} … {high:.3g}")
    parts = ", ".join(f"{cause} {100 * share:.2g} %" for cause, share in document["deviations"].items())
    say(f"deviations {parts}")
    say(
        f"line       {document['length_px']:.0f} px long, points ± {document['error_px']:.2g} px, "
        f"curl {document['curl_std_1_m']:.2g} 1/m"
    )
    for note in document["notes"]:
        say(f"note       {note}")


def _with_candidates(
    error: InputError, args: argparse.Namespace, photo: Path, picture: np.ndarray, search: RodSearch
) -> InputError:
    """The error with the name of a picture added, where one can be written: the photograph with numbered candidates
    and the known ends marked."""
    written = args.output or args.overlay
    path = (written.parent if written else Path()) / f"{photo.stem}_candidates.png"
    if path.resolve() == photo.resolve():
        return error
    from vbaa_calib.detect.drawing.canvas import Canvas

    colours = (0, 0, 255), (0, 255, 255), (255, 255, 0), (255, 0, 255), (0, 255, 0), (255, 128, 0)
    canvas = Canvas.over(_grey(picture))
    for number, found in enumerate(search.candidates, start=1):
        colour = colours[(number - 1) % len(colours)]
        canvas.line(found.curve_px, colour, 2.0)
        canvas.words(str(number), found.curve_px[len(found.curve_px) // 2], colour, size=1.2)
    for name, place in (("clamp", search.clamp), ("tip", search.tip)):
        if place is not None:
            canvas.ring(place, 8.0, (255, 255, 0))
            canvas.words(name, place, (255, 255, 0))
    try:
        _write_canvas(path, canvas, force=True)
    except InputError:
        return error
    content = "lines numbered" if search.candidates else "no line to number"
    return InputError(f"{error.what} ({content} in {path})", where=error.where, remedy=error.remedy)


def _grey(picture: np.ndarray) -> np.ndarray:
    import cv2

    levels = np.clip(picture, 0, 255).astype(np.uint8)
    return levels if levels.ndim == 2 else cv2.cvtColor(levels[..., :3], cv2.COLOR_BGR2GRAY)


def _write_canvas(path: Path, canvas: Canvas, force: bool) -> None:
    import cv2

    with replacing(path, force) as temporary:
        if not cv2.imwrite(str(temporary), canvas.image):
            raise InputError("cannot be written as a picture", where=path, remedy="take a name that ends in .png")


def _draw(path: Path, picture: np.ndarray, line: RodLine, force: bool) -> None:
    from vbaa_calib.detect.drawing.canvas import Canvas

    canvas = Canvas.over(_grey(picture))
    canvas.line(line.curve_px, (0, 0, 255), 1.5)
    for name, place in (("clamp", line.curve_px[0]), ("tip", line.curve_px[-1])):
        canvas.ring(place, 8.0, (255, 255, 0))
        canvas.words(name, place, (255, 255, 0))
    _write_canvas(path, canvas, force)
