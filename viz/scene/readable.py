"""Readability: numbers as colours with a scale, thinning, enlargement, round lengths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vbaa_calib.core.arrays import spread_evenly

if TYPE_CHECKING:
    from matplotlib.colors import LinearSegmentedColormap

    from .scene import Scene

MODES = ("force", "time", "uncertainty")
"""What contacts may be coloured by."""
_RAMPS = {
    "time": "440154 481769 472a7a 433e85 3c4f8a 355f8d 2e6f8e 287d8e 228b8d 1f9a8a 22a884 32b67a 4ec36b 6ece58 95d840 "
    "bddf26 e5e419",
    "force": "0d0887 2f0596 4903a0 6300a7 7a02a8 8f0da4 a51f99 b6308b c6417d d5536f e16462 eb7655 f58b47 fb9f3a feb72d "
    "fcce25 f6e826",
    "uncertainty": "feca66 feae4a fd953f fc6c33 f74327 e61f1d cb0a22 aa0026 800026",
    "surface": "08599c 1475b2 2d8fbf 47abcf 65c0cb 86d0c0 a6dcb6 c0e6c0 d4eece",
}
"""Colours from low to high, evenly spaced: viridis and plasma up to 0.96, parts of YlOrRd and of GnBu turned round."""


def thinned(indices: np.ndarray, most: int) -> np.ndarray:
    """At most `most` of the indices (N,), evenly spaced, with the first and the last among them."""
    return indices[spread_evenly(len(indices), most)]


def enlargement(sizes: np.ndarray, visible: float) -> int:
    """The round factor up to 100 by which the median of sizes (N,) must be enlarged to be visible."""
    known = sizes[np.isfinite(sizes)]
    wanted = visible / max(float(np.median(known)), 1e-12) if len(known) else 1.0
    return next((factor for factor in (1, 2, 5, 10, 20, 50) if factor >= wanted), 100)


def round_down(value: float) -> float:
    """The next 1, 2 or 5 times a power of ten that is not larger."""
    power = 10.0 ** float(np.floor(np.log10(value)))
    return float(f"{power * max(step for step in (1, 2, 5) if step * power <= value * (1 + 1e-9)):.1g}")


def on_ramp(stops: Sequence[str], share: np.ndarray) -> np.ndarray:
    """(N, 3) uint8 colours interpolated between evenly spaced ones "#rrggbb", at shares (N,) from 0 to 1; NaN counts
    as 0."""
    rgb = np.array([[int(stop[at : at + 2], 16) for at in (1, 3, 5)] for stop in stops], float)
    at = np.clip(np.nan_to_num(share), 0.0, 1.0) * (len(stops) - 1)
    return np.column_stack([np.interp(at, np.arange(len(stops)), part) for part in rgb.T]).round().astype(np.uint8)


def hexes(rgb: np.ndarray) -> list[str]:
    """Colours (N, 3) uint8 as "#rrggbb"."""
    return [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in rgb.tolist()]


@dataclass(frozen=True, eq=False)
class _Scale:
    """A colour scale, and the colours of N values on it.

    title, unit : what it shows. ticks : round values in that unit, from its low to its high end.
    rgb : (N, 3) uint8, grey for a value that is NaN.
    stops : hex colours from low to high.
    """

    title: str
    unit: str
    ticks: tuple[float, ...]
    rgb: np.ndarray
    stops: tuple[str, ...]

    @property
    def colormap(self) -> LinearSegmentedColormap:
        """The scale for matplotlib and pyvista."""
        from matplotlib.colors import LinearSegmentedColormap

        return LinearSegmentedColormap.from_list("scale", self.stops)

    @property
    def gradient(self) -> str:
        """The scale in CSS."""
        return f"linear-gradient(to right, {', '.join(self.stops)})"

    @property
    def ends(self) -> tuple[str, str, str]:
        """Texts for the scale's low end, its middle (title and unit) and its high end."""
        return f"{self.ticks[0]:.4g}", f"{self.title}, {self.unit}", f"{self.ticks[-1]:.4g}"


def contact_scale(scene: Scene, mode: str) -> _Scale:
    """The scale of the contacts by one of `MODES`."""
    contacts = scene.contacts
    if mode == "time":
        return _scale(contacts.time_s, "time", "s", "time")
    if mode == "uncertainty":
        return _scale(1e3 * contacts.principal[1][:, -1], "contact's std, worst axis", "mm", "uncertainty")
    return _scale(contacts.size_mN, "force on the antenna", "mN", "force")


def surface_scale(std_m: np.ndarray) -> _Scale:
    """The scale of a reconstructed surface by its standard deviation (N,): pale where it is large."""
    return _scale(1e3 * std_m, "std of the surface", "mm", "surface")


def object_scale(scene: Scene) -> _Scale | None:
    """The scale of the scene's reconstructed surface; None where its uncertainty is unknown."""
    if scene.object is None or not np.isfinite(scene.object.std_m).any():
        return None
    return surface_scale(scene.object.std_m)


def _scale(values: np.ndarray, title: str, unit: str, name: str) -> _Scale:
    """The ramp `name` over the values (N,).

    Its ticks are a handful of evenly spaced round numbers, the first and last of which hold all values; 0, 1 for none.
    """
    ticks: tuple[float, ...] = 0.0, 1.0
    known = np.isfinite(values)
    if known.any():
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        size = round_down(1.0001 * max(high - low, 0.05 * abs(high), 1e-9) / 4)
        first, last = int(np.floor(low / size + 1e-9)), int(np.ceil(high / size - 1e-9))
        count = max(last - first, 1)
        every = next((step for step in range(1, 6) if count <= 6 * step and count % step == 0), 1)
        ticks = tuple(float(size * index) for index in range(first, first + count + 1, every))
    stops = tuple(f"#{stop}" for stop in _RAMPS[name].split())
    share = (np.where(known, values, ticks[0]) - ticks[0]) / (ticks[-1] - ticks[0])
    rgb = np.where(known[:, None], on_ramp(stops, share), np.array((150, 158, 170), np.uint8))
    return _Scale(title, unit, ticks, rgb, stops)
