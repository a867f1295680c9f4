"""The middle line of a rod in one photograph: the line with the most evidence, if there is enough and no other has.

Nothing is assumed of the rod's colour, nor that it is one all along, only that it differs from what is on either side
of it. Pixel (0, 0) is the middle of the upper left one. `measure.py` searches and fits.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.polyline import arc_lengths

from .measure import Level, MeasuredRod, RodPath, fitted, levels_of, opponent, paths_at, shared
from .settings import RodSettings

_END_REMEDY = "give --clamp U,V and --tip U,V"


@dataclass(frozen=True, eq=False)
class RodLine:
    """A rod's middle line, from clamp to tip."""

    points_px: np.ndarray  # (N, 2) measured middles of the rod, in order
    curve_px: np.ndarray  # (M, 2) smooth line through them from clamp to tip, evenly spaced
    width_px: float  # median
    wander_px: float  # standard deviation of points about the curve
    tip_inside: bool  # whether the rod ends within the picture
    centre_px: np.ndarray  # (2,) middle of the picture
    evidence: float = 0.0  # log odds of a rod against background alone

    @property
    def length_px(self) -> float:
        """Arc length from clamp to tip."""
        return float(arc_lengths(self.curve_px)[-1])


@dataclass(frozen=True, eq=False)
class RodSearch:
    """Lines that may be the rod, the likeliest first, and why the first one cannot be taken for it, if it cannot."""

    candidates: list[MeasuredRod]
    centre_px: np.ndarray
    clamp: np.ndarray | None
    tip: np.ndarray | None
    settings: RodSettings = field(default_factory=RodSettings)

    def line(self, candidate: int | None = None) -> RodLine:
        """The rod's line; the candidate with this number, from 1, where one is chosen.

        Raises InputError where none stands out, where two may be meant, or where it is not known which end is clamped.
        """
        if candidate is not None:
            if not 1 <= candidate <= len(self.candidates):
                what = f"there is no candidate {candidate}, only {len(self.candidates)}"
                raise InputError(what, remedy="take a number of the picture with the candidates")
            return self._directed(self.candidates[candidate - 1])
        best = self.candidates[0] if self.candidates else None
        known = (self.clamp is not None) + (self.tip is not None)
        least = self.settings.least_evidence_known if known == 2 else self.settings.least_evidence_alone
        if known < 2 and best is not None and best.hangs:
            least = self.settings.least_evidence_hanging
        if best is None or best.evidence < least:
            where = " between clamp and tip" if known == 2 else ""
            remedy = "check --clamp and --tip" if known == 2 else _END_REMEDY
            raise InputError(f"no rod can be made out{where}: nothing stands out like one", remedy=remedy)
        least_mean = self.settings.least_mean if known == 2 else self.settings.least_mean_alone
        if best.parts["mean"] < least_mean:
            what = "no rod can be made out: the likeliest line is one only in parts"
            raise InputError(what, remedy="check --clamp and --tip" if known == 2 else _END_REMEDY)
        if known == 2 and best.gap_px is not None:
            u, v = best.gap_px
            what = f"the line between clamp and tip is interrupted near {u:.0f},{v:.0f}"
            raise InputError(what, remedy="clear what hides, touches or crosses it, and check --clamp and --tip")
        if known == 0 and best.goes_on_px is not None:
            u, v = best.goes_on_px
            what = f"the likeliest line goes on beyond {u:.0f},{v:.0f}, where it cannot be followed"
            raise InputError(what, remedy=f"{_END_REMEDY}, or choose with --candidate N")
        if known == 2:
            least_mean = best.parts["mean"] - self.settings.alike
            alike = [line.parts["mean"] > least_mean and not best.contains(line.curve_px) for line in self.candidates]
        else:
            alike = [line.evidence > self.settings.rival_share * best.evidence for line in self.candidates]
        rivals = [number for number, is_one in enumerate(alike[1:], start=2) if is_one]
        if rivals:
            numbers = ", ".join(map(str, range(1, rivals[-1]))) + f" and {rivals[-1]}"
            what = f"{1 + len(rivals)} things in it may be the rod: candidates {numbers}"
            raise InputError(what, remedy=f"choose with --candidate N, or {_END_REMEDY}")
        return self._directed(best)

    def _directed(self, found: MeasuredRod) -> RodLine:
        """From clamp to tip."""
        inside, ends = found.inside, found.curve_px[[0, -1]]
        if self.clamp is not None or self.tip is not None:
            turned = False  # it was fitted from the clamp to the tip
        elif inside[0] != inside[1]:
            turned = inside[0]
        elif not inside[0]:
            turned = ends[0, 1] > ends[1, 1]  # it leaves the picture at both: a rod hangs down from its clamp
        elif abs(found.holder[0] - found.holder[1]) > self.settings.least_holder_lead:
            turned = found.holder[1] > found.holder[0]
        else:
            places = " or ".join(f"--clamp {u:.0f},{v:.0f}" for u, v in ends)
            raise InputError("both ends of the rod are in the picture", remedy=f"say which is clamped: {places}")
        order = slice(None, None, -1) if turned else slice(None)
        tip_inside = inside[0] if turned else inside[1]
        return RodLine(
            found.points_px[order],
            found.curve_px[order],
            found.width_px,
            found.wander_px,
            tip_inside,
            self.centre_px,
            found.evidence,
        )


def search_rod(
    picture: np.ndarray,
    clamp: np.ndarray | None = None,
    tip: np.ndarray | None = None,
    settings: RodSettings | None = None,
) -> RodSearch:
    """Lines in a picture (H, W) or (H, W, 3) that may be the rod. Raises InputError for ends outside the picture."""
    height, width = picture.shape[:2]
    for name, place in (("clamp", clamp), ("tip", tip)):
        if place is not None and not (0 <= place[0] <= width - 1 and 0 <= place[1] <= height - 1):
            raise InputError(f"the {name} {place[0]:g},{place[1]:g} is outside the picture of {width}x{height} pixels")
    settings = settings or RodSettings()
    planes = opponent(picture)
    if clamp is not None and tip is not None:
        found = _between(planes, clamp, tip, settings)
    else:
        paths: list[RodPath] = []
        for level, width_px in levels_of(planes, settings):
            if any(path.width_px > settings.much_wider * width_px and path.is_clear(settings) for path in paths):
                break
            paths += paths_at(level, width_px, (clamp, tip), settings, settings.most_cost_alone)
        paths.sort(key=lambda path: -path.evidence)
        found = _lines(planes, _grouped(paths, settings), [clamp, tip], settings)
    if clamp is None and tip is None:
        found = [fit.alone(settings) for fit in found]
    if clamp is None or tip is None:
        found.sort(key=lambda fit: -fit.evidence)
    return RodSearch(_different(found), 0.5 * (np.array([width, height]) - 1.0), clamp, tip, settings)


def _between(planes: np.ndarray, clamp: np.ndarray, tip: np.ndarray, settings: RodSettings) -> list[MeasuredRod]:
    """Lines from clamp to tip, the likeliest first."""
    levels = levels_of(planes, settings)
    found = _ranked(_measured(planes, levels, clamp, tip, None, settings), settings)
    if found and not found[0].is_good(settings) and found[0].parts["mean"] > settings.coloured_mean:
        # of one colour, as at the ends
        colours = found[0].end_colours(planes)
        found = _ranked(found + _measured(planes, levels, clamp, tip, colours, settings), settings)
    return found


def _measured(
    planes: np.ndarray,
    levels: list[tuple[Level, float]],
    clamp: np.ndarray,
    tip: np.ndarray,
    colours: np.ndarray | None,
    settings: RodSettings,
) -> list[MeasuredRod]:
    """Lines from clamp to tip, from the widest ribbons to the narrowest, until one is as good as a rod's."""
    found: list[MeasuredRod] = []
    bound, mean = settings.most_cost, 0.0
    for level, width_px in levels:
        if any(line.is_good(settings) and line.width_px > 1.8 * width_px for line in found):
            break
        for path in paths_at(level, width_px, (clamp, tip), settings, bound, colours):
            length = arc_lengths(path.path_px)[-1]
            mean = max(mean, path.mean)
            if length < settings.least_aspect * width_px or path.mean < max(settings.least_path_mean, mean - 1.0):
                continue
            bound = min(bound, settings.slack[0] * path.cost + settings.slack[1])
            if any(line.contains(path.path_px) and width_px < 1.5 * line.width_px for line in found):
                continue
            line = fitted(planes, path, clamp, tip, settings)
            if line is not None:
                found.append(line)
    return found


def _ranked(found: list[MeasuredRod], settings: RodSettings) -> list[MeasuredRod]:
    """The likeliest first: of lines whose mean evidence is about the same the one with the most."""
    best = max((line.parts["mean"] for line in found), default=0.0)
    return sorted(found, key=lambda line: (line.parts["mean"] < best - settings.alike, -line.evidence))


def _lines(
    planes: np.ndarray, groups: list[list[RodPath]], ends: list[np.ndarray | None], settings: RodSettings
) -> list[MeasuredRod]:
    """The likeliest line of each group of paths."""
    found = []
    for group in groups:
        likely: MeasuredRod | None = None
        for path in group:
            fit = fitted(planes, path, ends[0], ends[1], settings)
            if fit is not None and (likely is None or fit.evidence > likely.evidence):
                likely = fit
            if likely is not None and 0.6 < likely.width_px / path.width_px < 1.7:
                break
        if likely is not None:
            found.append(likely)
    return found


def _grouped(paths: list[RodPath], settings: RodSettings) -> list[list[RodPath]]:
    """The best paths, each apart from those before it over half of its length, and with each one of another width."""
    groups: list[list[RodPath]] = []
    for path in paths:
        group = next((each for each in groups if shared(path, each[0], settings) > 0.5), None)
        if group is None:
            if len(groups) < settings.candidates:
                groups.append([path])
        elif len(group) == 1 and not 0.9 < path.width_px / group[0].width_px < 1.1:
            group.append(path)
    return groups


def _different(found: list[MeasuredRod]) -> list[MeasuredRod]:
    """Lines that do not run along likelier ones."""
    kept: list[MeasuredRod] = []
    for line in found:
        if not any(other.contains(line.curve_px, 0.5) for other in kept):
            kept.append(line)
    return kept
