"""Speed against error of the estimator's benchmark, and its hard cases: tables for the terminal, a figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .estimator_hard import HardRow
from .estimator_hostile import HostileRow
from .estimator_speed import ESTIMATOR, LINE, LOOP, PAPER, SpeedRow
from .figures import new_figure, save

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


def write_figure(path: Path, rows: Sequence[SpeedRow], force: bool) -> None:
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
