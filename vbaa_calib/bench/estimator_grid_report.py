"""What the estimator's accuracy benchmark leaves: two tables for the terminal, a figure."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path

from .estimator_grid import CellRow
from .estimator_rods import FORCE_GOAL, LOCATION_GOAL, SMALL_BIAS_SHARE, RodRow
from .estimator_statistics import standard_errors
from .estimator_summary import CLEARLY, OF_BOUND_GOAL, SummaryRow
from .figures import new_figure, save

_COLOURS = ("#0f766e", "#b45309", "#6d28d9", "#1d4ed8", "#be123c", "#64748b")
_MARKS = ("o", "s", "^", "D", "v", "x")


def grid_text(rows: Sequence[CellRow], lines: Sequence[SummaryRow]) -> str:
    """The grid's table for people: its summary, the statuses rig by rig, and the cells left out."""
    cells = [row for row in rows if row.quantity == "l"]
    run = [row for row in cells if row.draws]
    draws = run[0].draws if run else 0
    title = (
        f"matched scenes: {len(run)} of {len(cells)} cells, {draws} draws each; of_bound: rms error over the "
        "Cramér–Rao bound; bias: mean error in sampled\ndeviations; covered: 95 % intervals that hold the truth; "
        f"clearly: cells beyond the goal by more than {CLEARLY} standard errors"
    )
    head = (
        f"{'quantity':<10}{'measure':<10}{'goal':<14}{'all cells':>17}{'worst':>9}{'± in a cell':>13}{'beyond':>8}"
        f"{'clearly':>9}  worst cell"
    )
    text = [title, head]
    for line in lines:
        text.append(
            f"{line.quantity:<10}{line.measure:<10}{line.goal:<14}{line.pooled:>9.3f} ±{line.pooled_error:.3f}"
            f"{line.worst:>10.3f}{line.cell_error:>13.3f}{line.beyond:>8}{line.clearly:>9}  {line.worst_cell}"
        )
    text += ["", f"{'lens':<10}{'tilt':>5}{'cells':>7}{'ok %':>8}{'tip %':>8}{'without %':>11}{'l of bound':>12}"]
    for lens, tilt in dict.fromkeys((row.lens, row.tilt_deg) for row in run):
        own = [row for row in run if (row.lens, row.tilt_deg) == (lens, tilt)]
        shares = [100 * _mean([getattr(row, name) for row in own]) for name in ("ok", "tip_contact", "without_numbers")]
        ratio = _mean([row.of_bound**2 for row in own if row.of_bound is not None]) ** 0.5
        text.append(
            f"{lens:<10}{tilt:>5.0f}{len(own):>7}{shares[0]:>8.2f}{shares[1]:>8.2f}{shares[2]:>11.2f}{ratio:>12.3f}"
        )
    left_out = [f"{row.cell}: {row.left_out}" for row in cells if row.left_out]
    return "\n".join([*text, *(["", "left out:", *left_out] if left_out else [])])


def rod_text(rows: Sequence[RodRow]) -> str:
    """The rod's table for people."""
    title = (
        "scenes of the static rod, slopes up to 35°, weight, bow, clamp error; small bias: ok frames biased by at most "
        f"a third of their deviation (goal\n{100 * SMALL_BIAS_SHARE:.0f} %); location and force: rms relative errors "
        "at 5 mm and more, within 0.75 L, where the bound allows the goals of "
        f"{100 * LOCATION_GOAL:.0f} and {100 * FORCE_GOAL:.0f} %"
    )
    head = (
        f"{'population':<39}{'frames':>7}{'small bias %':>13}{'99th':>7}{'l of bound':>12}{'covered %':>11}"
        f"{'judged':>8}{'location %':>12}{'bound %':>9}{'force %':>9}{'bound %':>9}{'impossible %':>14}"
    )
    text = [title, head]
    for row in rows:
        small = "–" if row.small_bias is None else f"{100 * row.small_bias:.1f}"
        worst = "–" if row.bias_99 is None else f"{row.bias_99:.2f}"
        text.append(
            f"{row.population:<39}{row.frames:>7}{small:>13}{worst:>7}{row.l_of_bound:>12.3f}"
            f"{100 * row.l_covered:>11.1f}{row.judged:>8}"
            f"{100 * row.location:>12.2f}{100 * row.location_bound:>9.2f}{100 * row.force:>9.2f}"
            f"{100 * row.force_bound:>9.2f}{100 * row.impossible:>14.1f}"
        )
        text.append(f"    {row.statuses}; {row.models}")
    return "\n".join(text)


def write_figure(path: Path, rows: Sequence[CellRow], force: bool) -> None:
    """Error over bound of l and of f_y in every cell: lenses side by side, tilts by colour, rolls by mark."""
    run = [row for row in rows if row.draws and row.of_bound is not None]
    lenses, tilts = (list(dict.fromkeys(values)) for values in zip(*((r.lens, r.tilt_deg) for r in run), strict=True))
    rolls, reaches = list(dict.fromkeys(row.roll_deg for row in run)), sorted({row.reach for row in run})
    shown = [name for name in ("l", "f_y") if any(row.quantity == name for row in run)]
    figure = new_figure(4.2 * len(lenses), 6.5)
    panels = figure.subplots(len(shown), len(lenses), sharey=True, squeeze=False)
    for panel, (quantity, lens) in zip(panels.flat, product(shown, lenses), strict=True):
        panel.axhspan(0.0, OF_BOUND_GOAL, color="#e2e8f0", lw=0)
        panel.axhline(1.0, color="#94a3b8", lw=0.8)
        for row in run:
            if (row.lens, row.quantity) == (lens, quantity):
                tilt, roll = tilts.index(row.tilt_deg), rolls.index(row.roll_deg)
                x = reaches.index(row.reach) + 0.06 * (tilt - 1.5) + 0.26 * (roll - 1)
                error = 2 * (row.of_bound or 0.0) * standard_errors(row.draws).of_bound
                style = {"color": _COLOURS[tilt % 6], "marker": _MARKS[roll % 6], "markersize": 3.5, "lw": 0.8}
                panel.errorbar([x], [row.of_bound], yerr=[error], **style)
        panel.set_xticks(range(len(reaches)), [f"{reach:g}" for reach in reaches])
        panel.set_title(f"{quantity}, lens: {lens}", fontsize=9)
        panel.set_ylim(bottom=0.5)
    for panel in panels[:, 0]:
        panel.set_ylabel("rms error over the bound")
    for panel in panels[-1]:
        panel.set_xlabel("contact distance over length")
    for place, tilt_deg in enumerate(tilts):
        panels[0, 0].plot([], [], color=_COLOURS[place % 6], label=f"tilt {tilt_deg:.0f}°")
    for place, roll_deg in enumerate(rolls):
        panels[0, 0].plot([], [], _MARKS[place % 6], color="#334155", markersize=4, label=f"roll {roll_deg:.0f}°")
    figure.legend(loc="outside lower center", ncols=7, fontsize=8)
    figure.suptitle(f"{run[0].draws} draws a cell; bars: two standard errors; grey: the goal", fontsize=10)
    save(figure, path, force)


def _mean(values: Sequence[float | None]) -> float:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else float("nan")
