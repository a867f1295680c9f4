"""The check report's sections about a session: pictures of the board, the free antenna, the loads."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

import numpy as np

from viz.scene.markup import section

from .pictures import arrows, coverage
from .plots import by_radius, free_residuals, moments, stiffness_by_load, views_rms
from .tables import fixed, records, table


def session_sections(document: Mapping[str, Any]) -> list[str]:
    """Sections, none without a session; a part that the session lacks says so."""
    session = document["session"]
    if session is None:
        return []
    numbers = document["numbers"]
    return [_boards(session, numbers["lens"]), _pose(session["camera_pose"]), _antenna(session, numbers)]


def _missing(what: str) -> str:
    return f'<p class="none">not given: {escape(what)}</p>'


def _boards(session: Mapping[str, Any], lens: Mapping[str, Any]) -> str:
    boards, size = session["boards"], lens["image_size"]
    if not boards:
        return section("Pictures of the board", "", _missing("a usable picture of the board in intrinsics/ or plane/"))
    corners = np.concatenate([np.array(view["corners_px"], float).reshape(-1, 2) for view in boards])
    figures = (
        coverage(corners, size),
        arrows(boards, size),
        by_radius(boards, lens["values"][2:4]),
        views_rms(boards, session["boards_expected_rms_px"]),
    )
    body = '<div class="pair">' + "".join(f"<div>{figure}</div>" for figure in figures) + "</div>"
    if session["boards_dropped"]:
        dropped = records(
            session["boards_dropped"], (("name", "picture", None), ("reason", "why it was not used", None)), 2
        )
        body += f"<h3>Not used</h3>{dropped}"
    how = (
        "Seen less predicted, at each picture's own best pose of the board. Arrows that point every way are noise; "
        "arrows that agree with their neighbours are a lens that is off. Orange: the board in the jig; red: outliers. "
        "A pink field has no corner in these pictures: they say nothing of the lens there."
    )
    return section("Pictures of the board", how, body)


def _pose(pose: Mapping[str, Any] | None) -> str:
    if pose is None:
        return section("The camera against the antenna", "", _missing("a board in the jig (plane/)"))
    rows = [
        [f"{what} {axis}", fixed(value, 3), fixed(std, 3), f"{abs(value) / std:.1f}", unit]
        for what, unit, values, stds in (
            ("shift", "mm", pose["shift_mm"], pose["shift_std_mm"]),
            ("turn about", "mrad", pose["turn_mrad"], pose["turn_std_mrad"]),
        )
        for axis, value, std in zip("xyz", values, stds, strict=True)
    ]
    body = table(("motion since the calibration", "seen", "± predicted", "in std", "unit"), rows)
    how = (
        "Where the board in the jig puts the camera now, less where the rig has it, in the antenna's frame. ± is what "
        "chance allows: of the calibration, of the lens, and of the new picture. Shift and turn go together, so the "
        "verdict rests on all six at once, not on single rows."
    )
    return section("The camera against the antenna", how, body)


def _antenna(session: Mapping[str, Any], numbers: Mapping[str, Any]) -> str:
    free, loads = session["noload"], session["loads"]
    figures = []
    if free:
        figures.append(free_residuals(free, 1e3 * numbers["antenna"]["length_m"]))
    if loads:
        figures.append(stiffness_by_load(loads))
    read = [row for row in (*free, *loads) if row["moment_residual_mNm"] is not None]
    if read:
        figures.append(moments(read, numbers["moment_sensor"]["std_Nm"]))
    body = '<div class="pair">' + "".join(f"<div>{figure}</div>" for figure in figures) + "</div>"
    body += "" if free else _missing("the free antenna (noload/)")
    if loads:
        body += "<h3>Loads: predicted against seen</h3>" + records(
            [row | {"number": index + 1} for index, row in enumerate(loads)],
            (
                ("image", "picture", None),
                ("number", "load", 0),
                ("distance_mm", "at, mm", 0),
                ("force_y_mN", "f_y, mN", 1),
                ("force_z_mN", "f_z, mN", 1),
                ("predicted_deflection_mm", "bends, mm: predicted", 2),
                ("seen_deflection_mm", "seen", 2),
                ("stiffness_percent", "EI off, %", 2),
                ("stiffness_std_percent", "±", 2),
                ("rms_std", "points, std", 2),
                ("moment_predicted_mNm", "moment, mN·m: predicted", 3),
                ("moment_read_mNm", "read", 3),
                ("look_at", "look at", None),
            ),
        )
    else:
        body += _missing("known loads (loads/)")
    how = (
        "The free antenna's centreline against the rig's prediction; each load's own EI against the rig's; and the "
        "moment sensor's readings. One load alone off the others has a wrong row; all together, the rig has changed."
    )
    return section("Antenna and moment sensor", how, body)
