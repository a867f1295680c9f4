"""What the coverage benchmark leaves: a table for the terminal, a figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .coverage_run import COVERED_GOAL, RATIO_GOAL, RigRow, Row
from .figures import new_figure, save

_SHOWN = {"points on C": "#0f766e", "camera pose": "#b45309", "EI": "#6d28d9", "pose, antenna, sensor": "#64748b"}
"""Quantities of the figure → colour."""


def as_text(rows: Sequence[Row], rigs: Sequence[RigRow], draws: int) -> str:
    """The table for people."""
    title = (
        f"{draws} draws a rig; ratio: sampled over predicted standard deviation, then that of the worst number of the "
        "quantity;\ncovered: 95 % regions that hold the truth; bias: largest mean error, in predicted deviations; "
        f"goal: ratios within {100 * RATIO_GOAL:.0f} % and {100 * COVERED_GOAL[0]:.0f} to {100 * COVERED_GOAL[1]:.0f} %"
    )
    head = f"{'rig':<38}{'quantity':<23}{'ratio':>14}{'worst':>8}{'covered %':>14}{'bias':>8}{'predicted':>16}  goal"
    lines, rig = [title, head], ""
    for row in rows:
        shown, rig = (row.rig if row.rig != rig else ""), row.rig
        size = "–" if row.predicted_std is None else f"{row.predicted_std:.3g} {row.unit}"
        goal = ("met" if row.met else "missed") if row.judged else ""
        lines.append(
            f"{shown:<38}{row.quantity:<23}{row.ratio:>7.3f} ±{row.ratio_error:.3f} {row.worst_ratio:>7.3f}"
            f"{100 * row.covered:>8.1f} ± {100 * row.covered_error:.1f} {row.bias:>7.2f}{size:>16}  {goal}".rstrip()
        )
    return "\n".join([*lines, *(_about(rig) for rig in rigs)])


def _about(rig: RigRow) -> str:
    failed = f"; {rig.failed} of {rig.draws + rig.failed} failed: {'; '.join(rig.failures)}" if rig.failed else ""
    seconds = f"lens {rig.seconds_lens:.2f} s, plane C {rig.seconds_plane:.2f} s, joint {rig.seconds_joint:.2f} s"
    noise = f"noise of the centreline found at {rig.noise_scale:.2f} times its size"
    return f"{rig.rig:<38}medians: {seconds}; {noise}{failed}"


def write_figure(path: Path, rows: Sequence[Row], draws: int, force: bool) -> None:
    """Ratio and coverage of the main quantities, rig by rig, with two standard errors and the goal's band."""
    names = list(dict.fromkeys(row.rig for row in rows))
    figure = new_figure(11, 1.3 + 0.75 * len(names))
    left, right = figure.subplots(1, 2, sharey=True)
    left.axvspan(1 - RATIO_GOAL, 1 + RATIO_GOAL, color="#e2e8f0")
    right.axvspan(*(100 * share for share in COVERED_GOAL), color="#e2e8f0")
    left.axvline(1.0, color="#94a3b8", lw=0.8)
    right.axvline(95.0, color="#94a3b8", lw=0.8)
    for shift, (quantity, colour) in enumerate(_SHOWN.items()):
        own = [row for row in rows if row.quantity == quantity]
        y = [names.index(row.rig) + 0.18 * (shift - 1.5) for row in own]
        style = {"fmt": "o", "color": colour, "markersize": 4, "lw": 1.2}
        left.errorbar([r.ratio for r in own], y, xerr=[2 * r.ratio_error for r in own], label=quantity, **style)
        right.errorbar([100 * r.covered for r in own], y, xerr=[200 * r.covered_error for r in own], **style)
    left.set_yticks(range(len(names)), names, fontsize=9)
    left.invert_yaxis()
    left.set_xlabel("sampled over predicted standard deviation")
    right.set_xlabel("95 % regions that hold the truth, %")
    figure.legend(loc="outside lower center", ncols=len(_SHOWN), fontsize=8)
    figure.suptitle(f"{draws} noise draws a rig; bars: two standard errors; grey: the goal", fontsize=10)
    save(figure, path, force)
