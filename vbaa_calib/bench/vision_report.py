"""What the vision benchmark leaves: three tables for the terminal, a figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .figures import new_figure, save
from .vision_judge import FALSE_PX
from .vision_run import HardRow, HostileRow, MethodRow


def as_text(methods: Sequence[MethodRow], hard: Sequence[HardRow], hostile: Sequence[HostileRow]) -> str:
    """The tables for people."""
    lines = [
        f"good pictures, one thread, decoding not counted; rms of the points within {FALSE_PX} px, false: the others",
        f"{'picture':<10}{'method':<24}{'ms':>8}{'pictures/s':>12}{'rms px':>9}{'bias px':>9}{'kept %':>8}"
        f"{'false %':>9}",
    ]
    for row in methods:
        lines.append(
            f"{row.size:<10}{row.method:<24}{row.ms:>8.2f}{row.pictures_per_s:>12.0f}{row.rms_px:>9.4f}"
            f"{row.bias_px:>+9.4f}{100 * row.kept:>8.1f}{100 * row.false:>9.2f}"
        )
    lines += [
        "",
        "one hardship at a time, 512x512; × bound: rms over the Cramér–Rao bound's; × sigma: over the predicted",
        f"{'hardship':<22}{'found %':>8}{'rms px':>9}{'bias px':>9}{'× bound':>9}{'× sigma':>9}{'kept %':>8}"
        f"{'false %':>9}",
    ]
    for item in hard:
        lines.append(
            f"{item.hardship:<22}{100 * item.found:>8.1f}{item.rms_px:>9.4f}{item.bias_px:>+9.4f}{item.of_bound:>9.2f}"
            f"{item.of_sigma:>9.2f}{100 * item.kept:>8.1f}{100 * item.false:>9.3f}"
        )
    lines += ["", "hard pictures at random: verdicts in %, and confident ones that are false"]
    for mix in hostile:
        lines.append(
            f"{mix.kind:<24}{mix.pictures:>7} pictures: ok {100 * mix.ok:.1f}, no_antenna {100 * mix.no_antenna:.1f}, "
            f"too_little {100 * mix.too_little:.1f}, ambiguous {100 * mix.ambiguous:.1f}; "
            f"false {100 * mix.confident_false:.2f}"
        )
    return "\n".join(lines)


MARKS = {
    "this finder": ("#0f766e", "s"),
    "cv2.ximgproc.thinning": ("#b45309", "o"),
    "RidgeDetectionFilter": ("#6d28d9", "^"),
    "centroid per column": ("#1d4ed8", "D"),
}
"""Method → its colour and mark."""


def write_figure(path: Path, methods: Sequence[MethodRow], hard: Sequence[HardRow], force: bool) -> None:
    """Speed against error on the left, every hardship's error on the right."""
    figure = new_figure(11, 4.2)
    speed, errors = figure.subplots(1, 2)
    for row in methods:
        colour, mark = MARKS[row.method]
        big = row.size.startswith("1280")
        style = {"fillstyle": "none" if big else "full", "label": "_" if big else row.method}
        speed.loglog(row.pictures_per_s, row.rms_px, mark, color=colour, ls="", **style)
    speed.legend(fontsize=8, title="hollow: 1280x720, full: 512x512", title_fontsize=8)
    speed.set_xlabel("pictures per second, one thread")
    speed.set_ylabel("rms error across the antenna, px")
    speed.grid(alpha=0.3)
    names = [item.hardship for item in hard]
    errors.barh(names, [item.rms_px for item in hard], color="#0f766e")
    errors.invert_yaxis()
    errors.set_xlabel("rms error, px")
    errors.tick_params(labelsize=7)
    errors.grid(alpha=0.3, axis="x")
    save(figure, path, force)
