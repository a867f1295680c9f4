"""What a reader can take in: numbers as colours with a scale, fewer of many, larger where too small, round lengths."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import LinearSegmentedColormap

if TYPE_CHECKING:
    from .scene import Scene

MODES = ("force", "time", "uncertainty")
"""What contacts may be coloured by."""
UNKNOWN = (150, 158, 170)
"""Grey of what has no number."""
_ENLARGEMENTS = (1, 2, 5, 10, 20, 50, 100)


def thinned(indices: np.ndarray, most: int) -> np.ndarray:
    """At most so many of the indices (N,), evenly spread; the first and the last among them."""
    if len(indices) <= most:
        return indices
    return indices[np.unique(np.linspace(0, len(indices) - 1, most).round().astype(int))]


def enlargement(sizes: np.ndarray, visible: float) -> int:
    """How many times larger than life the middle one of sizes (N,) can be seen, a round number up to 100."""
    known = sizes[np.isfinite(sizes)]
    wanted = visible / max(float(np.median(known)), 1e-12) if len(known) else 1.0
    return next((factor for factor in _ENLARGEMENTS if factor >= wanted), _ENLARGEMENTS[-1])


def round_down(value: float) -> float:
    """The next 1, 2 or 5 times a power of ten that is not larger."""
    power = 10.0 ** float(np.floor(np.log10(value)))
    return float(f"{power * max(step for step in (1, 2, 5) if step * power <= value * (1 + 1e-9)):.1g}")


@dataclass(frozen=True, eq=False)
class Scale:
    """A colour scale and what it gives N values.

    title, unit : what it shows. ticks : round values in that unit, from its low to its high end.
    rgb : (N, 3) uint8, `UNKNOWN` for a value that is NaN.
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
        return LinearSegmentedColormap.from_list("scale", self.stops)

    @property
    def gradient(self) -> str:
        """The scale in CSS."""
        return f"linear-gradient(to right, {', '.join(self.stops)})"

    @property
    def ends(self) -> tuple[str, str, str]:
        """Its low end, its title, its high end."""
        return f"{self.ticks[0]:.4g}", f"{self.title}, {self.unit}", f"{self.ticks[-1]:.4g}"


def contact_scale(scene: Scene, mode: str) -> Scale:
    """The scale of the contacts by one of `MODES`."""
    contacts = scene.contacts
    if mode == "time":
        return scale(contacts.time_s, "time", "s", "viridis")
    if mode == "uncertainty":
        return scale(1e3 * contacts.principal[1][:, -1], "contact's std, worst axis", "mm", "YlOrRd", (0.3, 1.0))
    return scale(contacts.size_mN, "force on the antenna", "mN", "plasma")


def surface_scale(std_m: np.ndarray) -> Scale:
    """The scale of a reconstructed surface by its standard deviation (N,): the paler, the less is known."""
    return scale(1e3 * std_m, "std of the surface", "mm", "GnBu_r", (0.08, 0.8))


def object_scale(scene: Scene) -> Scale | None:
    """The scale of the scene's reconstructed surface; None where its uncertainty is unknown."""
    if scene.object is None or not np.isfinite(scene.object.std_m).any():
        return None
    return surface_scale(scene.object.std_m)


def scale(values: np.ndarray, title: str, unit: str, name: str, part: tuple[float, float] = (0.0, 0.96)) -> Scale:
    """`part` of matplotlib's colour map `name` over the values (N,).

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
    rgb8 = colormaps[name](np.linspace(*part, 256), bytes=True)[:, :3]
    step = np.interp(np.where(known, values, ticks[0]), (ticks[0], ticks[-1]), (0, 255)).round().astype(int)
    rgb = np.where(known[:, None], rgb8[step], np.array(UNKNOWN, np.uint8))
    stops = tuple("#{:02x}{:02x}{:02x}".format(*row) for row in rgb8[np.linspace(0, 255, 9).round().astype(int)])
    return Scale(title, unit, ticks, rgb, stops)
