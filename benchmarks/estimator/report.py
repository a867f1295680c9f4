"""Speed against error of the estimator's benchmark, and its hard cases: tables for the terminal, a figure."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path

from benchmarks.harness import new_figure, save

from .grid import CLEARLY, OF_BOUND_GOAL, CellRow, SummaryRow
from .hard import HardRow, HostileRow
from .rods import FORCE_GOAL, LOCATION_GOAL, SMALL_BIAS_SHARE, RodRow
from .speed import ESTIMATOR, LINE, LOOP, PAPER, SpeedRow
from .statistics import standard_errors

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


STYLES = {PAPER: ("#b45309", "o"), LINE: ("#6d28d9", "^"), LOOP: ("#64748b", "D"), ESTIMATOR: ("#0f766e", "s")}
"""Of each family of methods: its colour and mark."""


def speed_text(rows: Sequence[SpeedRow]) -> str:
    """The table for people."""
    title = (
        "200 points a frame; error: rms of the contact distance in standard deviations of the Cramér–Rao bound, at any "
        "roll up to 60° and\nwithin plane C; typical: from the median; least of several timings"
    )
    head = (
        f"{'method':<30}{'rig':<12}{'frames':>8}{'µs/frame':>11}{'frames/s':>12}{'error':>8}{'in C':>8}{'typical':>9}"
        f"{'answered %':>12}"
    )
    lines = [title, head]
    for row in rows:
        numbers = [_number(value) for value in (row.of_bound, row.of_bound_flat, row.typical)]
        share = _number(None if row.answered is None else 100 * row.answered)
        lines.append(
            f"{_label(row):<30}{row.rig:<12}{row.frames:>8}{row.us_per_frame:>11.2f}{1e6 / row.us_per_frame:>12.0f}"
            f"{numbers[0]:>8}{numbers[1]:>8}{numbers[2]:>9}{share:>12}"
        )
    loop = {row.method: row.us_per_frame for row in rows if row.family == LOOP}
    batch = {row.method: row.us_per_frame for row in rows if row.family == ESTIMATOR and row.rig == "exact"}
    lines += [
        f"the loop takes {spent / batch[rung]:.0f} times as long as the batch on the same rung, {rung}"
        for rung, spent in loop.items()
        if rung in batch
    ]
    return "\n".join(lines)


def hard_text(rows: Sequence[HardRow]) -> str:
    """The table for people."""
    title = (
        "hard cases; errors of the frames that came with numbers: rms and largest in their own deviations, rms in mm; "
        "condition: median, of the scaled information"
    )
    head = (
        f"{'case':<36}{'frames':>7}{'numbers %':>11}{'l rms':>8}{'l max':>8}{'l mm':>10}{'force rms':>11}{'max':>8}"
        f"{'condition':>11}  statuses"
    )
    lines = [title, head]
    for row in rows:
        if row.exception:
            lines.append(f"{row.case:<36}{row.frames:>7}  {row.exception}")
            continue
        values = [
            _number(value) for value in (row.l_rms_std, row.l_max_std, row.l_rms_mm, row.f_rms_std, row.f_max_std)
        ]
        condition = "–" if row.condition is None else f"{row.condition:.1e}"
        lines.append(
            f"{row.case:<36}{row.frames:>7}{100 * row.numbered:>11.1f}{values[0]:>8}{values[1]:>8}{values[2]:>10}"
            f"{values[3]:>11}{values[4]:>8}{condition:>11}  {row.statuses}"
        )
    return "\n".join(lines)


def hostile_text(rows: Sequence[HostileRow]) -> str:
    """Totals over all chunks, and the worst frames with what replays them."""
    frames, claimed = (sum(getattr(row, name) for row in rows) for name in ("frames", "claimed"))
    beyond = sum(row.beyond for row in rows)
    lines = [
        f"{frames} frames at random over everything: {sum(row.exceptions for row in rows)} exceptions, "
        f"{sum(row.nan for row in rows)} with NaN in what is claimed, {claimed} ok or tip_contact, of which {beyond} "
        f"beyond 6 deviations ({1e5 * beyond / max(claimed, 1):.1f} in 100,000) and "
        f"{sum(row.imagined for row in rows)} of a free antenna"
    ]
    worst = sorted((row for row in rows if row.worst_std is not None), key=lambda row: -(row.worst_std or 0.0))
    lines += [f"    {row.worst_std:.1f} deviations in {row.worst}: {_again(row)}" for row in worst[:10]]
    lines += [f"    {row.failure}: {_again(row)}" for row in rows if row.failure]
    return "\n".join(lines)


def write_speed_figure(path: Path, rows: Sequence[SpeedRow], force: bool) -> None:
    """Time a frame over error, frame by frame and in a batch; the bound is the wall at 1."""
    from matplotlib.lines import Line2D

    shown = [row for row in rows if row.of_bound is not None]
    figure = new_figure(12, 6)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    # the loop knows no batch: it stands in both panels
    single, batch = ([row for row in shown if row.family == LOOP or (row.frames > 1) == many] for many in (False, True))
    for panel, own, title in zip(panels, (single, batch), ("one frame at a time", "in a batch"), strict=True):
        panel.axvspan(0.5, 1.0, color="#e2e8f0", lw=0)
        panel.axvline(1.0, color="#334155", lw=1.2)
        for row, place in zip(own, _apart([row.us_per_frame for row in own]), strict=True):
            colour, mark = STYLES[row.family]
            at, face = (row.of_bound, row.us_per_frame), colour if row.rig == "exact" else "none"
            panel.loglog(*at, mark, color=colour, markerfacecolor=face, markersize=6)
            line = {"arrowstyle": "-", "lw": 0.4, "color": colour}
            beside = 1.25 * (row.of_bound or 0.0), place
            panel.annotate(row.method, at, xytext=beside, arrowprops=line, va="center", fontsize=6.5, color=colour)
        panel.set_title(title, fontsize=10)
        panel.grid(alpha=0.3)
        panel.set_xlabel("rms error of the contact distance over the Cramér–Rao bound")
    panels[0].set_xlim(0.7, 3.0 * max([row.of_bound or 0.0 for row in shown], default=1.0))
    panels[0].set_ylim(top=5.0 * max([row.us_per_frame for row in shown], default=1.0))
    panels[0].text(0.84, 0.02, "nothing\ncan be", fontsize=7, ha="center", transform=panels[0].get_xaxis_transform())
    panels[0].set_ylabel("time, µs per frame")
    marks = [Line2D([], [], ls="", marker=mark, color=colour, label=name) for name, (colour, mark) in STYLES.items()]
    marks.append(Line2D([], [], ls="", marker="s", color="#0f766e", markerfacecolor="none", label="rig not exact"))
    figure.legend(handles=marks, loc="outside lower center", ncols=5, fontsize=8)
    save(figure, path, force)


def _apart(times_us: Sequence[float], gap: float = 1.22) -> list[float]:
    """Heights for the labels of points at these times, each at least a factor of `gap` over the one below."""
    heights, below = [0.0] * len(times_us), 0.0
    for index in sorted(range(len(times_us)), key=lambda index: times_us[index]):
        below = heights[index] = max(times_us[index], gap * below)
    return heights


def _label(row: SpeedRow) -> str:
    return (
        f"all points, {row.method}"
        if row.family == ESTIMATOR
        else f"{LOOP}, {row.method}"
        if row.family == LOOP
        else row.method
    )


def _again(row: HostileRow) -> str:
    return f"replay(seed={row.seed}, chunk={row.chunk}, frames={row.frames})"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}" if abs(value) < 1000 else f"{value:.0e}"
