"""Put what one loses without each part of a rig, by the error budget of the demo's rig, into docs/build.md.

    vbaa simulate demo --pictures none -o session/
    vbaa calibrate session/ -o rig.json
    python docs/quote_losses.py rig.json

After a change that moves the budget.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from estimator.budget.budget import error_budget
from vbaa_calib.rig import Rig
from vbaa_calib.session import MomentSensor

PAGE = Path(__file__).parent / "build.md"
ROWS = {"distance_m": (0,), "point_m": (3, 4, 5), "force_N": (1, 2)}
"""Of a budget's variances."""


def less_known(rig: Rig, **std: float) -> Rig:
    """The rig with more variance of parameters, by the beginnings of their names."""
    covariance = rig.covariance.copy()
    for begin, by in std.items():
        for row, name in enumerate(rig.parameter_names):
            covariance[row, row] += by**2 if name.startswith(begin) else 0.0
    return rig.with_covariance(covariance)


def without_sensor(rig: Rig) -> Rig:
    """Vision alone."""
    covariance = rig.covariance.copy()
    covariance[15:17], covariance[:, 15:17] = 0.0, 0.0
    return replace(rig, moment_sensor=MomentSensor.none(), covariance=covariance, tip=None)


def noisier(rig: Rig, pixels: float = 1.0, moment: float = 1.0) -> Rig:
    """With so many times the noise of pixels and of the moment."""
    sensor = replace(rig.moment_sensor, std_Nm=moment * rig.moment_sensor.std_Nm)
    return replace(rig, image=replace(rig.image, noise_px=pixels * rig.image.noise_px), moment_sensor=sensor)


LOSSES: dict[str, Callable[[Rig], Rig]] = {
    "nothing: the demo's rig": lambda rig: rig,
    "the moment sensor": without_sensor,
    "a good amplifier: ten times the noise": lambda rig: noisier(rig, moment=10.0),
    "the camera's pixels, or paint and diffuse light: twice the noise": lambda rig: noisier(rig, pixels=2.0),
    "a lens that is locked: focal lengths off by 1 %": lambda rig: less_known(
        rig, fx=0.01 * rig.camera.matrix[0, 0], fy=0.01 * rig.camera.matrix[1, 1]
    ),
    "the jig: the camera's place to 1 mm, its angle to 3 mrad": lambda rig: less_known(
        rig, camera_x=1e-3, camera_y=1e-3, camera_z=1e-3, camera_about=3e-3
    ),
    "a stiff clamp: it turns by 3 mrad": lambda rig: less_known(rig, clamp_about=3e-3),
    "a straight wire: its bow not known to 0.1 /m": lambda rig: less_known(rig, bow_about=0.1),
    "weights: EI not known to 10 %": lambda rig: less_known(rig, log_stiffness=0.1),
}
"""What is missing, and the rig without it."""


def rows(rig: Rig) -> Iterator[tuple[str, dict[str, float], int]]:
    """Of each loss: its name, what half of the ordinary contacts are known better than, and how many are known at all;
    those that are not count as infinitely uncertain."""
    for name, made in LOSSES.items():
        budget = error_budget(made(rig))
        variance = sum(budget.variances.values(), np.zeros((1, 6)))
        lost = np.full(budget.asked - len(variance), np.inf)
        by_result = {each: np.sqrt(variance[:, list(row)].sum(axis=1)) for each, row in ROWS.items()}
        yield name, {each: float(np.median(np.append(std, lost))) for each, std in by_result.items()}, len(variance)


def table(rig: Rig) -> str:
    """The page's."""
    lines = ["| without | distance, mm | place, mm | force, mN | contacts |", "|---|---|---|---|---|"]
    for name, median, count in rows(rig):
        numbers = " | ".join(f"{1e3 * median[each]:.2g}" for each in ROWS)
        lines.append(f"| {name} | {numbers} | {count} |")
    return "\n".join(lines)


def main(path: Path) -> None:
    """Replace the table in the page."""
    old = re.compile(r"\| without \| distance.*?\n(?!\|)", re.DOTALL)
    page, count = old.subn(table(Rig.load(path)) + "\n", PAGE.read_text(encoding="utf-8"))
    if count != 1:
        raise ValueError(f"{PAGE.name} has {count} tables of losses")
    PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
