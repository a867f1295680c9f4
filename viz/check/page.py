"""The check report: one page that stands alone, made from check.json's contents and nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from viz.scene.markup import prose, section

from .pictures import heat_map
from .plots import LEVEL_COLOURS, gauge
from .session import session_sections
from .style import STYLE
from .tables import NOT_RECORDED, at, listing, number, records, scaled, table, with_std


def page(document: Mapping[str, Any]) -> str:
    """The whole report as HTML, from what `Assessment.to_dict` makes."""
    given, own = document["session_findings"], document["findings"]
    title = f"vbaa check · {document['rig']}"
    parts = [
        _header(document, given, own),
        _findings("Is it still right?", _ASKED, given) if given else "",
        _findings("What rig.json says of itself", _OWN, own),
        *session_sections(document),
        _maps(document),
        _numbers(document["numbers"]),
        _evidence(document["quality"]),
    ]
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{STYLE}</style></head>'
        f"<body><main>{''.join(parts)}<footer>{_FOOT}</footer></main></body></html>\n"
    )


_ASKED = (
    "Each answer weighs the new pictures against what the rig predicts, with the uncertainty of both. A difference "
    "counts when it is improbable (the bar: beyond the first edge to look at, beyond the second it does not hold) "
    "and larger than what would matter."
)
_OWN = "Without new pictures: is what was calibrated known well enough, and is it plausible?"
_FOOT = "± is one standard deviation. docs/check.md says how to read this page."


def _header(document: Mapping[str, Any], given: Sequence[Mapping], own: Sequence[Mapping]) -> str:
    verdict = document["verdict"]
    lines = [
        finding for level in ("does not hold", "look at") for finding in [*given, *own] if finding["level"] == level
    ]
    answered = [finding for finding in [*given, *own] if finding["level"] != "not given"]
    if lines:
        told = "".join(
            f"<p><b>{escape(finding['question'])}</b> {escape(finding['words'])}"
            + (f" <br>→ {prose(finding['remedy'])}" if finding["remedy"] else "")
            + "</p>"
            for finding in lines
        )
    else:
        told = f"<p>All {len(answered)} questions that could be answered are answered well.</p>"
    if document["session"] is None:
        told += "<p>Judged by rig.json alone: give new pictures to see whether it is still so.</p>"
    elif document["session"]["not_given"]:
        told += f"<p>Not given: {escape(', '.join(document['session']['not_given']))}.</p>"
    return (
        f'<header style="--level:{LEVEL_COLOURS[verdict]}"><h1>{escape(document["rig"])}</h1>'
        f'<div class="verdict">{escape(document["headline"])}</div>{told}</header>'
    )


def _findings(heading: str, how: str, findings: Sequence[Mapping[str, Any]]) -> str:
    rows = []
    for finding in findings:
        remedy, evidence = finding["remedy"], finding["evidence"]
        told = f'<span class="remedy">{prose(remedy)}</span>' if remedy else ""
        measure = ""
        if evidence is not None:
            measure = (
                f"{gauge(evidence)}{evidence['distance_std']:.1f} std; {number(evidence['size'], 3)} "
                f"{escape(evidence['unit'])}, {evidence['floor']:g} would not matter"
            )
        rows.append(
            f'<div class="finding" style="--level:{LEVEL_COLOURS[finding["level"]]}">'
            f'<span class="chip">{escape(finding["level"])}</span><div><b>{escape(finding["question"])}</b>'
            f'<span class="words">{escape(finding["words"])}</span>{told}</div>'
            f'<div class="measure">{measure}</div></div>'
        )
    return section(heading, how, "".join(rows))


def _maps(document: Mapping[str, Any]) -> str:
    maps, size = document["maps"], document["numbers"]["lens"]["image_size"]
    rays = {"has_ray": maps["has_ray"]}
    plane = heat_map("on plane C, mm", maps["plane"] | rays, size, maps["along_antenna"])
    projection = maps["projection"]
    lens = NOT_RECORDED if projection is None else heat_map("of the projection, px", projection | rays, size)
    along = table(
        ("along the antenna, mm", "± on plane C, mm"),
        [[f"{1e3 * row['arclength_m']:.0f}", number(row["std_mm"], 3)] for row in maps["along_antenna"]],
    )
    how = (
        "One standard deviation in the worst direction. The first map: where the ray of each pixel meets plane C, from "
        "lens and camera pose together; the orange line is the antenna's axis. The second: of the projection itself, "
        "with what a turn of the camera explains taken out. Grey: no answer there; a red dashed line is the edge of "
        "the lens' valid region."
    )
    share = document["numbers"]["lens"]["image_fraction"]
    valid = f"<p>The lens maps {100 * share:.4g} % of the picture one to one.</p>"
    return section(
        "How well is each pixel known?",
        how,
        f'<div class="pair"><div>{plane}</div><div>{lens}</div></div>{valid}<div class="narrow">{along}</div>',
    )


def _numbers(numbers: Mapping[str, Any]) -> str:
    lens, pose, antenna, sensor = (numbers[key] for key in ("lens", "camera_pose", "antenna", "moment_sensor"))
    std = lens["std"] or [None] * len(lens["values"])
    lens_rows = [
        [escape(name), with_std(value, own), "px" if name in ("fx", "fy", "cx", "cy") else ""]
        for name, value, own in zip(lens["parameters"], lens["values"], std, strict=True)
    ]
    pose_rows = [
        [f"position {axis}", with_std(value, own, 1e3), "mm"]
        for axis, value, own in zip("xyz", pose["translation_m"], pose["translation_std_m"], strict=True)
    ]
    pose_rows += [
        [f"turn about {axis}", f"<small>±</small> {number(1e3 * own, 2)}", "mrad"]
        for axis, own in zip("xyz", pose["rotation_std_rad"], strict=True)
    ]
    nominal = antenna["nominal_stiffness_Nm2"]
    antenna_rows = [
        ["EI", with_std(antenna["stiffness_Nm2"], antenna["stiffness_std_Nm2"], 1e3), "mN·m²"],
        ["EI nominal, E·πd⁴/64", "not recorded" if nominal is None else number(1e3 * nominal, 5), "mN·m²"],
        ["mass per length", with_std(antenna["mass_per_length_kg_m"], antenna["mass_per_length_std_kg_m"], 1e3), "g/m"],
        ["length", number(1e3 * antenna["length_m"]), "mm"],
        ["diameter", number(1e3 * antenna["diameter_m"]), "mm"],
        *(_shape_row(row) for row in antenna["free_shape"]),
    ]
    sensor_rows = [
        ["gain", with_std(sensor["gain"], sensor["gain_std"]), ""],
        ["offset", with_std(sensor["offset_Nm"], sensor["offset_std_Nm"], 1e6), "µN·m"],
        ["noise of a reading", number(1e6 * sensor["std_Nm"]), "µN·m"],
    ]
    head = ("what", "value", "unit")
    tables = (
        ("Camera in the antenna's frame", pose_rows),
        (f"Lens ({lens['model']}, {lens['image_size'][0]} × {lens['image_size'][1]} px)", lens_rows),
        ("Antenna", antenna_rows),
        ("Moment sensor", sensor_rows),
    )
    body = "".join(f"<div><h3>{escape(name)}</h3>{table(head, rows)}</div>" for name, rows in tables)
    return section("What was calibrated", "Everything with its standard deviation.", f'<div class="pair">{body}</div>')


def _shape_row(row: Mapping[str, Any]) -> list[str]:
    name = str(row["name"])
    scale, unit = (1.0, "1/m") if name.endswith("_per_m") else (1e3, "mrad" if name.endswith("_rad") else "mm")
    for end in ("_per_m", "_rad", "_m"):
        name = name.removesuffix(end)
    return [escape(name.replace("_", " ")), with_std(row["value"], row["std"], scale), unit]


def _evidence(quality: Mapping[str, Any]) -> str:
    """What the calibration wrote down of itself."""
    models = records(
        at(quality, "lens", "model_comparison"),
        (
            ("model", "lens", None),
            ("free_parameters", "free numbers", 0),
            ("rms_px", "rms, px", 4),
            ("held_out_rms_px", "unseen views, px", 4),
            ("halves", "halves differ, std", 2),
            ("monotonic", "one to one", None),
        ),
    )
    dropped = records(at(quality, "lens", "dropped"), (("name", "picture", None), ("reason", "why", None)), 2)
    if at(quality, "lens", "dropped") == []:
        dropped = "<p>No picture was dropped.</p>"
    stills = records(
        scaled(at(quality, "stills"), "moment_residual_Nm", 1e6),
        (
            ("image", "picture", None),
            ("distance_m", "load at, m", 3),
            ("point_rms", "points, std", 2),
            ("moment_residual_Nm", "moment residual, µN·m", 1),
            ("kept", "used", None),
        ),
    )
    words = at(quality, "lens", "verdict")
    lens = f"<p>{escape(words)}</p>" if isinstance(words, str) else ""
    body = (
        f"<h3>Lens models compared</h3>{lens}{models}<h3>Pictures of the board that were not used</h3>{dropped}"
        f"<h3>Ways to plane C</h3>{listing(at(quality, 'plane'))}"
        f"<h3>Stills of the antenna</h3>{stills}"
        f"<h3>Assumptions checked</h3>{listing(at(quality, 'checks'))}"
    )
    how = "Written down when the rig was calibrated: how the lens was chosen, what was dropped and why."
    return section("What the rig rests on", how, body)
