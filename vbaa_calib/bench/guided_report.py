"""What the benchmark of suggested poses leaves: a table for the terminal, a figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .figures import new_figure, save
from .guided_rigs import GOAL_MM
from .guided_run import Row
from .guided_ways import PEOPLE, SUGGESTED

SHARE_GOAL = 2.0 / 3.0
"""Pictures that suggested poses may need, for each that random ones need."""

_COLOURS = ("#0f766e", "#b45309", "#6d28d9", "#64748b", "#be185d")


def pictures_needed(rows: Sequence[Row], name: str) -> int | None:
    """Of one rig and way: pictures from which on the number `name`, mm, stays at or below the goal; None for never."""
    needed: int | None = None
    for row in sorted(rows, key=lambda row: -row.pictures):
        value = getattr(row, name)
        if value is None or value > GOAL_MM:
            break
        needed = row.pictures
    return needed


def as_text(rows: Sequence[Row], draws: int) -> str:
    """The table for people: after how many pictures the goal is reached, and errors on the way."""
    title = (
        f"{draws} seeds; mm on C, rms over seeds: true, and predicted; off: true error in predicted deviations, "
        f"rms and median;\nneeded: pictures from which on it stays within {GOAL_MM} mm, truly and as predicted"
    )
    head = f"{'rig':<36}{'poses':<24}{'needed':>8}{'predicted':>11}   errors: pictures true/predicted (off, median)"
    lines, previous = [title, head], ""
    for rig, way in dict.fromkeys((row.rig, row.way) for row in rows):
        own = [row for row in rows if (row.rig, row.way) == (rig, way)]
        shown, previous = (rig if rig != previous else ""), rig
        needed, foreseen = (pictures_needed(own, name) for name in ("true_rms_mm", "predicted_mm"))
        picked = [row for row in own if row.pictures in (3, 4, 6, 10, 15, 24)]
        errors = "  ".join(_errors(row) for row in picked)
        lines.append(f"{shown:<36}{way:<24}{_count(needed, own):>8}{_count(foreseen, own):>11}   {errors}")
    return "\n".join([*lines, *(_verdict(rows, rig) for rig in dict.fromkeys(row.rig for row in rows))])


def _errors(row: Row) -> str:
    predicted = "–" if row.predicted_mm is None else f"{row.predicted_mm:.3f}"
    off = "–" if row.off is None else f"{row.off:.2f}, {row.off_median:.2f}"
    return f"{row.pictures}: {row.true_rms_mm:.3f}/{predicted} ({off})"


def _count(needed: int | None, rows: Sequence[Row]) -> str:
    return f"> {max(row.pictures for row in rows)}" if needed is None else str(needed)


def _verdict(rows: Sequence[Row], rig: str) -> str:
    ours, random = ([row for row in rows if (row.rig, row.way) == (rig, way)] for way in (SUGGESTED, PEOPLE))
    if not ours or not random:
        return f"{rig:<36}not compared"
    first, second = pictures_needed(ours, "true_rms_mm"), pictures_needed(random, "true_rms_mm")
    if first is None:
        return f"{rig:<36}missed: suggested poses do not reach the goal in {max(row.pictures for row in ours)} pictures"
    most = max(row.pictures for row in random)
    share = first / (second or most)
    size = f"{'at most ' if second is None else ''}{share:.2f} of the pictures that random poses need"
    return f"{rig:<36}{'met' if share <= SHARE_GOAL else 'missed'}: {size}"


def write_figure(path: Path, rows: Sequence[Row], force: bool) -> None:
    """True (line) and predicted (dashes) error over the number of pictures, rig by rig."""
    names, ways = list(dict.fromkeys(row.rig for row in rows)), list(dict.fromkeys(row.way for row in rows))
    figure = new_figure(4.2 * len(names), 4.0)
    for panel, name in zip(figure.subplots(1, len(names), squeeze=False)[0], names, strict=True):
        panel.axhline(GOAL_MM, color="#334155", lw=0.8)
        for way, colour in zip(ways, _COLOURS, strict=False):
            own = [row for row in rows if (row.rig, row.way) == (name, way)]
            if not own:
                continue
            counts = [row.pictures for row in own]
            panel.loglog(counts, [row.true_rms_mm for row in own], "o-", color=colour, markersize=3, lw=1.4, label=way)
            panel.loglog(counts, [row.predicted_mm or float("nan") for row in own], "--", color=colour, lw=0.9)
        panel.set_ylim(0.003, 3.0)
        panel.set_xticks([3, 4, 6, 10, 15, 24], ["3", "4", "6", "10", "15", "24"])
        panel.set_title(name, fontsize=9)
        panel.set_xlabel("pictures")
        panel.grid(alpha=0.3)
        panel.legend(fontsize=7, title="true; dashed: predicted", title_fontsize=7)
    figure.axes[0].set_ylabel("error of points on plane C, mm rms")
    save(figure, path, force)
