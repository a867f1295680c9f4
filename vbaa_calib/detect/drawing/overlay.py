"""A debug picture of a detection: corridor, centreline with its standard deviations, hidden parts, clamp and visible
end."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from vbaa_calib.core.polyline import normals
from vbaa_calib.detect.whisker.acceptance import Cause, Stretch
from vbaa_calib.detect.whisker.centreline import Centreline, Visibility
from vbaa_calib.detect.whisker.corridor import Corridor

from .canvas import WHITE, Canvas, Colour, Key, strip
from .settings import DrawingSettings

HIDDEN: Colour = (40, 140, 255)  # of hidden stretches
OUTSIDE: Colour = (150, 150, 150)  # of stretches outside the picture
_CAUSES: dict[Cause, Colour] = {
    Cause.FAINT: (235, 120, 170),
    Cause.REVERSED: (110, 215, 110),
    Cause.DISTURBED: (190, 160, 255),
    Cause.BLURRED: (190, 180, 60),
    Cause.HIDDEN: HIDDEN,
    Cause.OUTSIDE: OUTSIDE,
}
"""Colours of unseen stretches."""
# of the visible end
_END_WORDS = {
    "tip": "tip",
    "unsure": "perhaps the tip",
    "hidden": "hidden from here",
    "border": "leaves the picture",
    "none": "",
}


def background(image: np.ndarray, where: Corridor | None) -> np.ndarray:
    """(H, W) uint8: a grey picture (H, W) of any type, darkened, more so outside the corridor."""
    grey = np.nan_to_num(np.asarray(image, np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    low, high = np.percentile(grey[::3, ::3], (1.0, 99.8))
    grey = (
        DrawingSettings.brightest
        * np.clip((grey - low) / max(high - low, DrawingSettings.least_span), 0.0, 1.0) ** DrawingSettings.gamma
    )
    if where is not None and len(where.axis_px) >= 2:
        grey = np.where(
            corridor_mask(where, (grey.shape[1], grey.shape[0])) > 0, grey, DrawingSettings.outside_corridor * grey
        )
    return grey.astype(np.uint8)


def centreline_picture(
    image: np.ndarray, line: Centreline, where: Corridor | None, words: tuple[str, ...], parts: Sequence[Stretch] = ()
) -> np.ndarray:
    """(H, W, 3) uint8, blue, green, red: a grey picture (H, W) with the detection drawn in it, over a legend.

    words : title and notes. parts : seen and unseen stretches, if known.
    """
    canvas = Canvas.over(background(image, where))
    if where is not None:
        draw_corridor(canvas, where)
    draw_centreline(canvas, line, parts)
    if where is not None:
        draw_clamp(canvas, where)
    # the badge's colour, and what it means
    colour, meaning = {
        "ok": ((136, 148, 13), "the antenna was found"),
        "no_antenna": ((139, 116, 100), "there is no antenna, or it cannot be made out"),
        "too_little": ((11, 158, 245), "too little of the antenna is seen"),
        "ambiguous": ((38, 38, 220), "two lines could be the antenna"),
    }[line.verdict]
    lines, width = [line.reason, described(line), *words[1:]], canvas.image.shape[1]
    legend = strip(width, canvas.unit, (line.verdict, colour), (meaning, words[0]), lines, keys(line, where, parts))
    return np.vstack([canvas.image, legend])


def corridor_mask(where: Corridor, image_size: tuple[int, int]) -> np.ndarray:
    """(H, W) uint8, 255 where the antenna may be."""
    mask = np.zeros((image_size[1], image_size[0]), np.uint8)
    left, right = _corridor_sides(where)
    for i in range(len(left) - 1):
        quad = np.stack([left[i], left[i + 1], right[i + 1], right[i]])
        cv2.fillConvexPoly(mask, cv2.convexHull(np.rint(np.clip(quad, -8e3, 8e3)).astype(np.int32)), 255)
    return mask


def _corridor_sides(where: Corridor) -> tuple[np.ndarray, np.ndarray]:
    """(M, 2) and (M, 2): the corridor's two sides, from clamp to tip."""
    reach = where.reach_px[:, None] * normals(where.axis_px)
    return where.axis_px - reach, where.axis_px + reach


def draw_corridor(canvas: Canvas, where: Corridor) -> None:
    """Draw the corridor's outline and the predicted free antenna."""
    left, right = _corridor_sides(where)
    canvas.line(np.concatenate([left, right[::-1], left[:1]]), DrawingSettings.corridor)
    canvas.dashes(where.axis_px, DrawingSettings.free, 1.5)


def draw_clamp(canvas: Canvas, where: Corridor) -> None:
    """Draw the clamp, where the free antenna starts."""
    canvas.ring(where.axis_px[0], 6.0, WHITE)
    canvas.words("clamp", where.axis_px[0], WHITE, (9.0, 20.0))


def draw_centreline(canvas: Canvas, line: Centreline, parts: Sequence[Stretch] = (), *, named: bool = True) -> None:
    """Draw points coloured by standard deviation, unseen stretches dashed (coloured by cause if `parts` has one), a
    second line, and the visible end."""
    if len(line.other_line_px):
        canvas.line(line.other_line_px, DrawingSettings.other_line, 2.0)
    for part in parts:
        if part.cause in _CAUSES:
            canvas.dashes(part.path_px, _CAUSES[part.cause], 2.0, 5.0)
    coarse = ((Visibility.OUTSIDE, OUTSIDE), (Visibility.BEYOND, HIDDEN), (Visibility.HIDDEN, HIDDEN))
    for visibility, colour in () if parts else coarse:
        for piece in line.stretches(visibility):
            canvas.dashes(piece, colour, 2.0, 5.0)
    canvas.graded(line.points_px, sigma_colours(line.sigma_px))
    if line.end != "none" and np.isfinite(line.end_px).all():
        colour = WHITE if line.end == "tip" else HIDDEN if line.end == "hidden" else OUTSIDE
        canvas.ring(line.end_px, 6.0, colour)
        if named:
            canvas.words(_END_WORDS[line.end], line.end_px, colour, (9.0, -9.0) if line.end == "tip" else (-2.0, -14.0))


def sigma_colours(sigma_px: np.ndarray) -> np.ndarray:
    """(N, 3) uint8 colours of standard deviations (N,) px: cyan is exact, magenta is uncertain."""
    low, high = np.log(DrawingSettings.sigma_range_px)
    share = (np.log(np.maximum(np.nan_to_num(sigma_px, nan=np.inf), 1e-6)) - low) / (high - low)
    share = np.clip(share, 0.0, 1.0)[:, None]
    return np.rint(
        (1.0 - share) * np.array(DrawingSettings.sure, float) + share * np.array(DrawingSettings.unsure, float)
    ).astype(np.uint8)


def keys(line: Centreline | None, where: Corridor | None, parts: Sequence[Stretch] = ()) -> list[Key]:
    """The legend of what is drawn."""
    low, high = DrawingSettings.sigma_range_px
    scale = sigma_colours(np.geomspace(low, high, 64))
    points = Key(f"centreline, std {low:g} to {high:g} px", mark="scale", scale=scale)
    visible = set() if line is None or parts else set(np.asarray(line.visibility).tolist())
    causes = {part.cause for part in parts}
    there = (
        (line is None or len(line.points_px) > 0, points),
        *((cause in causes, Key(cause.words, colour, "dashes")) for cause, colour in _CAUSES.items()),
        (bool(visible & {Visibility.HIDDEN, Visibility.BEYOND}), Key("hidden, or not measured", HIDDEN, "dashes")),
        (Visibility.OUTSIDE in visible, Key("outside the picture", OUTSIDE, "dashes")),
        (line is not None and len(line.other_line_px) > 0, Key("the other line", DrawingSettings.other_line)),
        (where is not None, Key("free antenna, predicted", DrawingSettings.free, "dashes")),
        (where is not None, Key("where it may be", DrawingSettings.corridor)),
    )
    return [key for is_drawn, key in there if is_drawn]


def described(line: Centreline) -> str:
    """The detection in words and numbers."""
    if not len(line.points_px):
        return "no point of the antenna was measured"
    low, middle, high = np.percentile(line.sigma_px, (5, 50, 95))
    parts = [
        f"{100 * line.seen:.0f} % of its length seen, {len(line.points_px)} points",
        f"std across it {middle:.3f} px ({low:.3f} to {high:.3f})",
    ]
    hidden = float((np.asarray(line.visibility) == Visibility.HIDDEN).mean()) if len(line.visibility) else 0.0
    if hidden:
        parts.append(f"{100 * hidden:.0f} % not seen between seen parts")
    if line.end != "none":
        u, v = line.end_px
        parts.append(f"visible end at ({u:.1f}, {v:.1f}) px: {_END_WORDS[line.end]}")
    if line.amplitude and line.noise:
        parts.append(f"{line.amplitude:.0f} grey levels over its surroundings, noise {line.noise:.1f}")
    if line.breadth and abs(line.breadth - 1.0) > 0.2:
        parts.append(f"{line.breadth:.1f} times as broad as in focus")
    return "; ".join(parts)
