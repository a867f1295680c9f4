"""What the headline benchmark says in words: its tables, and one sentence."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from .chain_judge import ASTRAY_BOUND, ASTRAY_STATED
from .chain_losses import LossRow
from .chain_methods import OURS
from .chain_run import ChainRow
from .chain_stages import StageRow

_NOTES = f"""\
wall of error: the Cramér–Rao bound from the picture's own pixels and the moment's noise, friction and rig free within
  what is known of them; held as known: cross-section, blur and noise of the picture; free in every column: the line's
  height, level and slope of the background
wall of time: every byte of a picture read once from memory
wrong: off by more than {ASTRAY_BOUND:.0f} of the bound's deviations, and by more than {ASTRAY_STATED:.0f} of its
  own where a method states them; * told by the truth where it is straight
ms: one thread's processor time from the decoded picture to distance and force; what needs no picture is
  prepared before"""


def as_text(rows: Sequence[ChainRow], spent: Sequence[StageRow], lost: Sequence[LossRow]) -> str:
    """The tables for people."""
    lines = [headline_sentence(rows), _NOTES]
    for (size, rig), own in groupby(rows, key=lambda row: (row.size, row.rig)):
        lines += ["", *_methods(size, rig, list(own))]
    lines += ["", *_losses(lost), "", *_stages(spent)]
    return "\n".join(lines)


def headline(rows: Sequence[ChainRow]) -> str:
    """At most 100 characters for a summary."""
    row = _chosen(rows)
    return (
        f"picture to contact, auto, {row.size}: {row.ms:.0f} ms, {_number(row.of_bound)} × the bound; "
        f"reading it {row.read_ms:.3f} ms"
    )


def headline_sentence(rows: Sequence[ChainRow]) -> str:
    """What it comes down to."""
    row = _chosen(rows)
    return (
        f"auto, {row.size}, a calibrated rig: {row.ms:.1f} ms a picture, {row.ms_recording:.1f} ms in a recording; "
        f"{_number(row.l_rms_mm)} mm rms, {_number(row.of_bound)} ± {_number(row.of_bound_error)} times the bound; "
        f"reading the picture once takes {row.read_ms:.3f} ms"
    )


def _chosen(rows: Sequence[ChainRow]) -> ChainRow:
    """`auto` on the largest pictures of a rig as calibrations leave it."""
    return [row for row in rows if (row.family, row.method, row.rig) == (OURS, "auto", "calibrated")][-1]


def _methods(size: str, rig: str, rows: Sequence[ChainRow]) -> list[str]:
    first = rows[0]
    title = (
        f"{size}, rig {rig}, {first.pictures} pictures; the walls: {first.bound_mm:.3f} mm rms, {first.read_ms:.4f} ms"
    )
    head = (
        f"{'method':<35}{'ms':>8}{'recording':>11}{'l rms mm':>10}{'median':>8}{'× bound':>9}{'±':>6}{'force %':>9}"
        f"{'°':>7}{'answered %':>12}{'wrong %':>9}"
    )
    lines = [title, head]
    family = ""
    for row in rows:
        if row.family != family:
            family = row.family
            lines.append(family)
        values = (row.l_rms_mm, row.l_median_mm, row.of_bound, row.of_bound_error, row.force_percent, row.direction_deg)
        shown = "".join(f"{_number(value):>{width}}" for value, width in zip(values, (10, 8, 9, 6, 9, 7), strict=True))
        lines.append(
            f"  {row.method + (' *' if row.told else ''):<33}{row.ms:>8.1f}{row.ms_recording:>11.1f}{shown}"
            f"{100 * row.answered:>12.0f}{100 * row.wrong:>9.0f}"
        )
    return lines


def _losses(rows: Sequence[LossRow]) -> list[str]:
    lines = [
        "where accuracy goes: rms error of the distance in the bound's deviations, from points without noise, from "
        "points as good as the picture allows,\nand from the picture; noise of the found points over the least; share "
        "of the columns with a point; the points' stated deviations over their noise",
        f"{'picture':<12}{'rig':<12}{'rung':<10}{'no noise':>10}{'best points':>13}{'picture':>9}{'points':>9}"
        f"{'kept %':>8}{'stated':>8}",
    ]
    lines += [
        f"{row.size:<12}{row.rig:<12}{row.model:<10}{_number(row.noiseless):>10}{_number(row.ideal):>13}"
        f"{_number(row.picture):>9}{_number(row.points):>9}{100 * row.kept:>8.1f}{_number(row.stated):>8}"
        for row in rows
    ]
    return lines


def _stages(rows: Sequence[StageRow]) -> list[str]:
    lines = [
        "where the time goes, auto, two looks; ms of a picture that comes alone and of each in a recording",
        f"{'picture':<12}{'stage':<28}{'ms':>8}{'recording':>11}{'share %':>9}",
    ]
    lines += [
        f"{row.size:<12}{row.stage:<28}{row.ms:>8.3f}{row.ms_recording:>11.3f}{100 * row.share:>9.1f}" for row in rows
    ]
    return lines


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}" if abs(value) < 100 else f"{value:.0f}"
