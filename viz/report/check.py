"""The report of `vbaa check`: one page, made from check.json alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from vbaa_calib.core.files import at
from viz.figures import check as figures
from viz.figures.settings import STYLE
from viz.pages.page import Table, fixed, listing, number, records, render, with_std

LENSES = (
    ("model", "lens", None),
    ("free_parameters", "free numbers", 0),
    ("rms_px", "rms, px", 4),
    ("held_out_rms_px", "held out, px", 4),
    ("halves", "halves differ, std", 2),
    ("monotonic", "one to one", None),
)
DROPPED = (("name", "picture", None), ("reason", "why it was not used", None))
"""Keys of rows of check.json and rig.json, their headings and decimals."""


def page(document: Mapping[str, Any]) -> str:
    """The report as HTML, from the document of `Assessment.to_dict`."""
    findings = [*document["session_findings"], *document["findings"]]
    maps, numbers, session = document["maps"], document["numbers"], document["session"]
    rays, size = {"has_ray": maps["has_ray"]}, numbers["lens"]["image_size"]
    drawn = [figures.heat_map("on plane C, mm", maps["plane"] | rays, size, maps["along_antenna"])]
    if maps["projection"] is not None:
        drawn.append(figures.heat_map("of the projection, px", maps["projection"] | rays, size))
    along = [[f"{1e3 * row['arclength_m']:.0f}", number(row["std_mm"], 3)] for row in maps["along_antenna"]]
    level_colours = {"holds": STYLE.teal, "look at": STYLE.amber, "does not hold": STYLE.red, "not given": STYLE.slate}
    return render(
        "check.html.j2",
        title=document["rig"],
        own_pictures=document["own_pictures"],
        colour=level_colours[document["verdict"]],
        colours=level_colours,
        headline=document["headline"],
        problems=[one for level in ("does not hold", "look at") for one in findings if one["level"] == level],
        answered=sum(one["level"] != "not given" for one in findings),
        session_findings=document["session_findings"],
        own_findings=document["findings"],
        session=session,
        maps=[axes.svg() for axes in drawn],
        lens_map_recorded=maps["projection"] is not None,
        along_antenna=Table(("along the antenna, mm", "± on plane C, mm"), along, ("along the antenna, mm",)),
        numbers=numbers,
        calibrated=_calibrated(numbers),
        **_quality(document["quality"]),
        **({} if session is None else _session(session, numbers)),
    )


def _session(session: Mapping[str, Any], numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Figures and tables of the new pictures."""
    lens, boards, free, loads = numbers["lens"], session["boards"], session["noload"], session["loads"]
    over_boards, antenna = [], []
    if boards:
        over_boards = [
            figures.coverage(boards, lens["image_size"]),
            figures.residual_arrows(boards, lens["image_size"]),
            figures.residuals_by_radius(boards, lens["values"][2:4]),
            figures.views_rms(boards, session["boards_expected_rms_px"]),
        ]
    if free:
        antenna.append(figures.free_residuals(free, 1e3 * numbers["antenna"]["length_m"]))
    if loads:
        antenna.append(figures.stiffness_by_load(loads))
    read = [row for row in (*free, *loads) if row["moment_residual_mNm"] is not None]
    if read:
        antenna.append(figures.moment_residuals(read, numbers["moment_sensor"]["std_Nm"]))
    pose, motion = session["camera_pose"], None  # of the camera since the calibration, axis by axis
    if pose is not None:
        rows = [
            [f"{what} {axis}", fixed(value, 3), fixed(std, 3), f"{abs(value) / std:.1f}", unit]
            for what, key, unit in (("shift", "shift", "mm"), ("turn about", "turn", "mrad"))
            for axis, value, std in zip("xyz", pose[f"{key}_{unit}"], pose[f"{key}_std_{unit}"], strict=True)
        ]
        head = ("motion since the calibration", "seen", "± predicted", "in std", "unit")
        motion = Table(head, rows, head[:1])
    columns = (
        ("image", "picture", None),
        ("number", "load", 0),
        ("distance_mm", "at, mm", 0),
        ("force_y_mN", "f_y, mN", 1),
        ("force_z_mN", "f_z, mN", 1),
        ("predicted_deflection_mm", "deflection, mm: predicted", 2),
        ("seen_deflection_mm", "seen", 2),
        ("stiffness_percent", "EI off, %", 2),
        ("stiffness_std_percent", "±", 2),
        ("rms_std", "points, std", 2),
        ("moment_predicted_mNm", "moment, mN·m: predicted", 3),
        ("moment_read_mNm", "read", 3),
        ("look_at", "look at", None),
    )
    return {
        "boards": [drawn.svg() for drawn in over_boards],
        "dropped_boards": records(session["boards_dropped"], DROPPED, 2),
        "motion": motion,
        "antenna": [drawn.svg() for drawn in antenna],
        "loads": records([row | {"number": index + 1} for index, row in enumerate(loads)], columns),
    }


def _calibrated(numbers: Mapping[str, Any]) -> list[tuple[str, Table]]:
    """Table of all numbers of the rig, with standard deviations."""
    lens, pose, antenna, sensor = (numbers[key] for key in ("lens", "camera_pose", "antenna", "moment_sensor"))
    lens_std = lens["std"] or [None] * len(lens["values"])
    nominal = antenna["nominal_stiffness_Nm2"]
    places = zip("xyz", pose["translation_m"], pose["translation_std_m"], strict=True)
    turns = zip("xyz", pose["rotation_std_rad"], strict=True)
    shape = []
    for row in antenna["free_shape"]:
        kinds = (("_per_m", 1.0, "1/m"), ("_rad", 1e3, "mrad"), ("_m", 1e3, "mm"), ("", 1e3, "mm"))
        end, scale, unit = next(kind for kind in kinds if row["name"].endswith(kind[0]))
        name = row["name"].removesuffix(end).replace("_", " ")
        shape.append([name, with_std(row["value"], row["std"], scale), unit])
    tables = {
        "Camera in the antenna's frame": [
            *([f"position {axis}", with_std(value, own, 1e3), "mm"] for axis, value, own in places),
            *([f"turn about {axis}", f"± {number(1e3 * own, 2)}", "mrad"] for axis, own in turns),
        ],
        f"Lens ({lens['model']}, {lens['image_size'][0]} × {lens['image_size'][1]} px)": lens_rows(
            lens["parameters"], lens["values"], lens_std
        ),
        "Antenna": [
            _row("EI", antenna, "stiffness", "_Nm2", 1e3, "mN·m²"),
            ["EI nominal, E·πd⁴/64", "not recorded" if nominal is None else number(1e3 * nominal, 5), "mN·m²"],
            _row("mass per length", antenna, "mass_per_length", "_kg_m", 1e3, "g/m"),
            ["length", number(1e3 * antenna["length_m"]), "mm"],
            ["diameter", number(1e3 * antenna["diameter_m"]), "mm"],
            *shape,
        ],
    }
    if sensor is not None:
        tables["Moment sensor"] = [
            _row("gain", sensor, "gain", "", 1.0, ""),
            _row("offset", sensor, "offset", "_Nm", 1e6, "µN·m"),
            ["noise of a reading", number(1e6 * sensor["std_Nm"]), "µN·m"],
        ]
    return [(name, Table(("what", "value", "unit"), rows, ("what",))) for name, rows in tables.items()]


def lens_rows(names: Iterable[str], values: Iterable[float], stds: Iterable[float | None]) -> list[list[str]]:
    """A row for each parameter of a lens: name, value with standard deviation, unit."""
    return [
        [name, with_std(float(value), std), "px" if name in ("fx", "fy", "cx", "cy") else ""]
        for name, value, std in zip(names, values, stds, strict=True)
    ]


def _row(words: str, data: Mapping[str, Any], name: str, suffix: str, scale: float, unit: str) -> list[str]:
    return [words, with_std(data[name + suffix], data[f"{name}_std{suffix}"], scale), unit]


def _quality(quality: Mapping[str, Any]) -> dict[str, Any]:
    """The calibration's own record of its quality; any part may be missing or of another form."""
    verdict, frames, dropped = at(quality, "lens", "verdict"), at(quality, "stills"), at(quality, "lens", "dropped")
    if isinstance(frames, list):
        frames = [
            row | {"moment_residual_uNm": 1e6 * residual} if isinstance(residual, int | float) else row
            for row, residual in ((row, at(row, "moment_residual_Nm")) for row in frames)
        ]
    columns_of_frames = (
        ("image", "picture", None),
        ("distance_m", "load at, m", 3),
        ("point_rms", "points, std", 2),
        ("moment_residual_uNm", "moment residual, µN·m", 1),
        ("kept", "used", None),
    )
    return {
        "lens_verdict": verdict if isinstance(verdict, str) else "",
        "lens_models": records(at(quality, "lens", "model_comparison"), LENSES),
        "nothing_dropped": dropped == [],
        "dropped": records(dropped, DROPPED, 2),
        "plane": listing(at(quality, "plane")),
        "stills": records(frames, columns_of_frames),
        "checks": listing(at(quality, "checks")),
        "guide": guide if isinstance(guide := at(quality, "guide", "words"), str) else "",
    }
