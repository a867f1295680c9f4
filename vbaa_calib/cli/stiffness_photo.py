"""`vbaa stiffness PHOTO.jpg`: the photograph's part of the verb."""

from __future__ import annotations

import argparse
import csv
import io
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError, about
from vbaa_calib.core.files import refuse_outputs, replacing, sha256, write_json, write_text

if TYPE_CHECKING:
    from vbaa_calib.calibrate.photo.centreline import RodLine, RodSearch
    from vbaa_calib.calibrate.photo.stiffness import PhotoSetting, PhotoStiffness
    from vbaa_calib.detect.drawing.canvas import Canvas


def configure(parser: argparse.ArgumentParser) -> None:
    """Flags for a photograph."""
    group = parser.add_argument_group("photograph", "pixels count from the middle of the upper left one")
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


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Find the rod, solve, report; write what is asked for. Returns its numbers."""
    from vbaa_calib.calibrate.photo.centreline import search_rod
    from vbaa_calib.calibrate.photo.stiffness import solve_photo
    from vbaa_calib.core.images import read_picture

    photos = [args.table, *([args.unloaded] if args.unloaded else [])]
    outputs = [path for path in (args.output, args.moments, args.overlay) if path is not None]
    refuse_outputs(outputs, args.force, photos)
    setting = _setting(args)
    pictures = [read_picture(path) for path in photos]
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
    _report(document)
    if args.moments:
        text = io.StringIO()
        writer = csv.DictWriter(text, document["moment_curvature"][0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(document["moment_curvature"])
        write_text(args.moments, text.getvalue(), args.force)
    if args.output:
        write_json(args.output, document, args.force)
    for path in outputs:
        say(f"wrote {path}")
    return document


def _setting(args: argparse.Namespace) -> PhotoSetting:
    """What the flags say. Raises InputError for what cannot be."""
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


def _report(document: dict[str, Any]) -> None:
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
    """The error, with the name of a picture in which candidates are numbered and known ends ringed, if it can be."""
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
        canvas.words(str(number), found.curve_px[len(found.curve_px) // 2], colour)
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
