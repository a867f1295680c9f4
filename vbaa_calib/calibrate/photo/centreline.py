"""The middle line of a rod in one photograph: the line with the most evidence, if there is enough and no other has.

Nothing is assumed of the rod's colour, nor that it is one all along, only that it differs from what is on either side
of it. Pixel (0, 0) is the middle of the upper left one. `candidates.py` searches, `measure.py` fits.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.polyline import arc_lengths, beside

from .candidates import Level, RodPath, grown, opponent, searched, shared
from .measure import MeasuredRod, fitted, smoothed
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
        share = self.settings.rival_share_known if known == 2 else self.settings.rival_share
        rivals = [
            number
            for number, other in enumerate(self.candidates[1:], start=2)
            if other.evidence > share * best.evidence
        ]
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


def find_rod(picture: np.ndarray, clamp: np.ndarray | None = None, tip: np.ndarray | None = None) -> RodLine:
    """The rod's line in a picture (H, W) grey or (H, W, 3) blue, green, red; its ends (2,) in pixels as clicked, or
    None to look for them. Raises InputError as `RodSearch.line` does.
    """
    return search_rod(picture, clamp, tip).line()


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
    low, high = _region(planes, clamp, tip, settings)
    part = planes[:, low[1] : high[1], low[0] : high[0]]
    ends = [None if place is None else place - low for place in (clamp, tip)]
    paths = [_from_clamp(path, *ends) for path in searched(part, ends[0], ends[1], settings)]
    found = [line.moved(low) for line in _lines(part, _grouped(paths, settings), ends, settings)]
    best = max(found, key=lambda fit: fit.evidence, default=None)
    good = best is not None and best.gap_px is None and best.parts["mean"] > settings.good_mean
    good = good and best is not None and best.parts["gaps"] <= settings.good_gaps
    if clamp is not None and tip is not None and not good:
        # one that takes another way is longer, and has more evidence only by that
        least = 0.0 if best is None else best.parts["mean"] + settings.winding_lead
        found += [line for line in _winding(planes, clamp, tip, settings) if line.parts["mean"] > least]
    if clamp is None and tip is None:
        found = [fit.alone(settings) for fit in found]
    found.sort(key=lambda fit: -fit.evidence)
    return RodSearch(_different(found), 0.5 * (np.array([width, height]) - 1.0), clamp, tip, settings)


def _lines(
    planes: np.ndarray, groups: list[list[RodPath]], ends: list[np.ndarray | None], settings: RodSettings
) -> list[MeasuredRod]:
    """The likeliest line of each group of paths."""
    noise = Level(planes, 1.0).noise(settings)
    smooth = smoothed(planes)
    found, alone = [], all(each is None for each in ends)
    for number, group in enumerate(groups):
        likely: MeasuredRod | None = None
        for path in group:
            whole = grown(planes, path, True, settings) if number < settings.grown_rounds and alone else path
            fit = fitted(smooth, noise, whole, ends[0], ends[1], settings)
            if fit is not None and (likely is None or fit.evidence > likely.evidence):
                likely = fit
            if likely is not None and 0.6 < likely.width_px / path.width_px < 1.7:
                break
        if likely is not None:
            found.append(likely)
    return found


def _winding(planes: np.ndarray, clamp: np.ndarray, tip: np.ndarray, settings: RodSettings) -> list[MeasuredRod]:
    """Lines that come by both clamp and tip, among those that are found without knowing these."""
    whole = []
    for likeliest, *_ in _grouped(searched(planes, None, None, settings), settings)[: settings.winding_rounds]:
        line = grown(planes, likeliest, True, settings)
        near = 2.0 * line.width_px + settings.click_share * np.hypot(*planes.shape[1:])
        away = [np.hypot(*(line.path_px - end).T) for end in (clamp, tip)]
        first, last = (int(np.argmin(each)) for each in away)
        if max(away[0][first], away[1][last]) < near and abs(last - first) > 4:
            on = line.path_px[first : last + 1] if first < last else line.path_px[last : first + 1][::-1]
            whole.append([RodPath(on, line.width_px, line.evidence)])
    return _lines(planes, whole, [clamp, tip], settings)


def _region(
    planes: np.ndarray, clamp: np.ndarray | None, tip: np.ndarray | None, settings: RodSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Corners (2,) of the part of the picture in which a rod between clamp and tip can be."""
    size = np.array(planes.shape[:0:-1])
    if clamp is None or tip is None:
        return np.zeros(2, int), size
    middle, half = 0.5 * (clamp + tip), 0.5 * np.hypot(*(tip - clamp))
    # an ellipse about both ends
    long, short = settings.detour * half, half * np.sqrt(settings.detour**2 - 1.0)
    along = (tip - clamp) / max(2.0 * half, 1e-9)
    reach = np.hypot(long * along, short * along[::-1]) + 0.15 * half + 30.0
    low = np.clip(np.floor(middle - reach), 0, size - 1).astype(int)
    return low, np.clip(np.ceil(middle + reach) + 1, low + 1, size).astype(int)


def _from_clamp(path: RodPath, clamp: np.ndarray | None, tip: np.ndarray | None) -> RodPath:
    first, last = path.path_px[0], path.path_px[-1]
    if clamp is not None:
        turned = np.hypot(*(last - clamp)) < np.hypot(*(first - clamp))
    else:
        turned = tip is not None and np.hypot(*(first - tip)) < np.hypot(*(last - tip))
    return RodPath(path.path_px[::-1], path.width_px, path.evidence) if turned else path


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
        along = [np.abs(beside(other.curve_px, line.curve_px)[1]) < 0.5 * other.width_px for other in kept]
        if all(np.mean(each) < 0.5 for each in along):
            kept.append(line)
    return kept
