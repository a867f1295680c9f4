"""The error budget as a figure: what makes up each result, and the distance along the antenna."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vbaa_calib.core.files import replacing

from .budget import CAUSES, OWN, Budget
from .parts import FORCE_PRIOR, per_result
from .report import TABLES, sum_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_CALIBRATION = "calibration"
_SHORT = {"distance_m": "l", "force_y_N": "f_y", "force_z_N": "f_z", "point_m": "world\npoint"}
_LEAST_SHARE = 0.1  # of the variance, in percent, that is drawn
_STYLES: dict[str, dict[str, Any]] = {
    name: {"color": cause.colour, "label": cause.name} for name, cause in CAUSES.items()
}
_STYLES[_CALIBRATION] = {"color": "#334155", "label": _CALIBRATION}


def write_figure(path: Path, budget: Budget, force: bool) -> None:
    """Stacked shares of each result, those of the calibration's part, and the deviation of l along the antenna."""
    from matplotlib.figure import Figure

    calibrated = any(cause not in OWN for cause in budget.variances)
    along = len(np.unique(budget.touches.distance_m)) > 1
    panels = 1 + calibrated + along
    figure = Figure(figsize=(1.0 + 4.6 * panels, 5.2), layout="constrained")
    axes = list(figure.subplots(1, panels, squeeze=False)[0])
    _bars(axes[0], budget, _grouped(budget), "what makes up each deviation", whole=True)
    if calibrated:
        of_rig = {cause: rows for cause, rows in budget.variances.items() if cause not in OWN}
        _bars(axes[1], budget, of_rig, "the calibration's part, common to all frames", whole=False)
    if along:
        _along(axes[-1], budget)
    with replacing(path, force) as temporary:
        figure.savefig(temporary, dpi=110, format=path.suffix[1:].lower())


def _grouped(budget: Budget) -> dict[str, np.ndarray]:
    """Noise and friction by cause, and the calibration as one."""
    own = {cause: rows for cause, rows in budget.variances.items() if cause in OWN}
    rest = [rows for cause, rows in budget.variances.items() if cause not in OWN]
    return own | ({_CALIBRATION: np.sum(rest, axis=0)} if rest else {})


def _bars(axes: Axes, budget: Budget, variances: Mapping[str, np.ndarray], title: str, whole: bool) -> None:
    means = {cause: np.array([per_result(rows)[name].mean() for name in TABLES]) for cause, rows in variances.items()}
    total: np.ndarray = np.sum(list(means.values()), axis=0)
    bottom = np.zeros(len(TABLES))
    for cause, style in _STYLES.items():
        height = 100.0 * means.get(cause, 0.0 * total) / np.where(total > 0.0, total, 1.0)
        if height.max() >= _LEAST_SHARE:
            axes.bar(range(len(TABLES)), height, 0.62, bottom, **style)
            bottom = bottom + height
    for place, name in enumerate(TABLES):
        std = 1e3 * (budget.results[name].std if whole else budget.results[name].common_std)
        axes.text(place, 101.5, f"{std:.3g} {'mm' if name.endswith('_m') else 'mN'}", ha="center", fontsize=8)
    axes.set_xticks(range(len(TABLES)), [_SHORT[name] for name in TABLES])
    axes.set_ylim(0, 108)
    axes.set_ylabel("share of the variance, %")
    axes.set_title(title, fontsize=10)
    axes.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=3, frameon=False)


def _along(axes: Axes, budget: Budget) -> None:
    """The deviation of l over the distance, rms over directions and loads."""
    distances, which = np.unique(budget.touches.distance_m, return_inverse=True)
    count = np.bincount(which)

    def rms_mm(rows: np.ndarray) -> np.ndarray:
        return np.asarray(1e3 * np.sqrt(np.bincount(which, per_result(rows)["distance_m"]) / count))

    axes.plot(1e3 * distances, rms_mm(sum_of(budget)), color="black", lw=2, marker="o", ms=4, label="all")
    for cause, rows in _grouped(budget).items():
        if cause != FORCE_PRIOR:
            axes.plot(1e3 * distances, rms_mm(rows), marker="o", ms=3, **_STYLES[cause])
    axes.set_yscale("log")
    axes.set_xlabel("contact's distance l, mm")
    axes.set_ylabel("deviation of l, mm (rms over forces)")
    axes.set_title("along the antenna", fontsize=10)
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=3, frameon=False)
