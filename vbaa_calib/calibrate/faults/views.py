"""Faults of pictures of the board: focus, lens centre, print, coverage, poses; one picture against those before it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from scipy.special import ndtr

from targets.board import Board, BoardPoints, BoardSpec, corner_points
from vbaa_calib.calibrate.lens.board_shape import STRETCH, BoardShape
from vbaa_calib.calibrate.lens.bundle import Bundle, free_directions, rows
from vbaa_calib.calibrate.lens.information import kept_observations
from vbaa_calib.calibrate.lens.intrinsics import LensSolution
from vbaa_calib.calibrate.lens.models import LENS_MODELS
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.core.least_squares import without_own
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.detect.board.view_quality import fixes_homography
from vbaa_calib.detect.quality.screen import LEAST_CORNERS

_SAME_SHAPE = 0.01
_MOVED_SQUARES = 0.5  # a board that moved by less than so many of its squares is in the same place
_RESHAPED = 0.006  # _Change of its outline's shape, rms per extent, below which it is tilted as before, to about 6°
_FEWEST_VIEWS = 5
_TILTED_DEG = 15.0
_LEAST_HULL, _REPEATED = 0.5, 0.5
_OPEN = 1e-9
_CHANGE_VIEWS, _SIDE_VIEWS = 6, 2  # fewest views that show a change between views, and that lie on either side of it
_STRETCH_SIGNIFICANT, _STRETCH_NOTICEABLE = 5.0, 2e-3
_SEED, _DRAWS, _MOST_NUMBERS = 0, 40_000, 8_000_000
_CHANCE = 4e-4  # of a false alarm by each of the five tests: 1 in 500 together
_NOTICEABLE, _GRAVE = 1e-3, 3e-3  # changes of the focal length, relative; of the centre, over the focal length in px


def resolution_changed(size: tuple[int, int], first: tuple[int, int]) -> Diagnosis | None:
    """Why a picture of `size` (width, height) px differs from the first one in size; None where it does not."""
    if tuple(size) == tuple(first):
        return None
    wide, high = size[0] / first[0], size[1] / first[1]
    remedy = "set the camera to the mode of the first picture, or begin anew in this one: the lens is another for it"
    if (size[1], size[0]) == tuple(first):
        name, cause = "picture_turned", "width and height are exchanged"
        remedy = "hold the camera as before, and switch off that pictures are turned upright"
    elif abs(wide - high) < _SAME_SHAPE * high:
        name, cause = "picture_scaled", f"it is scaled by {wide:.3g}"
        remedy = "set the camera to the resolution of the first picture, and copy originals, no previews"
    elif wide <= 1.0 and high <= 1.0:
        name, cause = "picture_cropped", "it is cropped, or the camera is in another mode"
    else:
        name = "picture_cropped"
        cause = "the camera is in another mode, which may cut off a border or use other pixels"
    seen = f"the picture is {size[0]}x{size[1]} px, the first one {first[0]}x{first[1]} px"
    return Diagnosis(name, f"{seen}: {cause}", remedy, "wrong")


def same_pose(view: BoardView, earlier: Sequence[BoardView], spec: Board | BoardPoints) -> Diagnosis | None:
    """The nearest earlier view that shows the board in (nearly) the same pose, if one does."""
    near = [(distance, other) for other in earlier if (distance := _apart_px(view, other, spec)) is not None]
    if not near:
        return None
    distance, other = min(near, key=lambda one: one[0])
    return Diagnosis(
        "same_pose",
        f"the board is as in {other.name}, its corners {distance:.1f} px from there",
        "tilt it differently, or move it to another part of the picture",
    )


def _apart_px(view: BoardView, other: BoardView, spec: Board | BoardPoints) -> float | None:
    """Rms distance of the corners that both show, px, where the pose counts as the same; else None."""
    ids, mine, theirs = np.intersect1d(view.ids, other.ids, return_indices=True)
    if len(ids) < LEAST_CORNERS or 2 * len(ids) < max(len(view.ids), len(other.ids)):
        return None
    plane = corner_points(spec)[ids, :2]
    if view.image_size != other.image_size or not fixes_homography(plane):
        return None
    here, there = view.corners_px[mine], other.corners_px[theirs]
    moved_px = float(np.sqrt(((here - there) ** 2).sum(axis=1).mean()))
    extent_px = float(np.sqrt(((here - here.mean(axis=0)) ** 2).sum(axis=1).mean()))
    extent_m = float(np.sqrt(((plane - plane.mean(axis=0)) ** 2).sum(axis=1).mean()))
    square_px = spec.pitch_m * extent_px / extent_m
    # what a shift, a turn in the picture and a change of scale leave
    first, second = ((points - points.mean(axis=0)) @ np.array([1.0, 1.0j]) for points in (here, there))
    factor = np.vdot(first, second) / np.vdot(first, first)
    reshaped_px = float(np.sqrt(np.mean(np.abs(second - factor * first) ** 2)))
    same = moved_px < _MOVED_SQUARES * square_px and reshaped_px < _RESHAPED * 2.0 * extent_px
    return moved_px if same else None


def _poorly_covered(views: Sequence[BoardView], spec: Board | BoardPoints) -> Diagnosis | None:
    """Whether the corners leave out much of the picture, and which of its corners; at least one view."""
    size, pixels = np.array(views[0].image_size), np.concatenate([view.corners_px for view in views])
    hull = float(cv2.contourArea(cv2.convexHull(pixels.astype(np.float32)))) / size.prod() if len(pixels) > 2 else 0.0
    column, row = np.clip((pixels + 0.5) / size * (4, 3), 0, (3, 2)).astype(int).T
    places = {"upper left": (0, 0), "upper right": (3, 0), "lower left": (0, 2), "lower right": (3, 2)}
    empty = [name for name, (x, y) in places.items() if not ((column == x) & (row == y)).any()]
    if hull >= _LEAST_HULL and len(empty) < 2:
        return None
    where = f", none in the {', '.join(empty)}" if empty else ""
    return Diagnosis(
        "border_empty",
        f"the corners reach over {100 * hull:.0f} % of the picture{where}",
        f"show the board in the {empty[0] if empty else 'picture’s corners'}"
        + (", also partly outside" if isinstance(spec, BoardSpec) else ""),
    )


def _little_variety(views: Sequence[BoardView], solution: LensSolution, spec: Board | BoardPoints) -> list[Diagnosis]:
    """Poses that repeat, boards that are never tilted, or about one axis only."""
    found: list[Diagnosis] = []
    kept: list[BoardView] = []
    for view in views:
        if all(_apart_px(view, other, spec) is None for other in kept):
            kept.append(view)
    if len(views) - len(kept) >= _REPEATED * len(views):
        words = f"{len(views)} pictures show the board in {len(kept)} poses only"
        remedy = "one picture of each pose is enough: turn and move the board between them"
        found.append(Diagnosis("same_poses", words, remedy))
    # boards whose normals hardly spread, or along one line only
    normals = np.array([view.T_camera_board.rotation[:, 2] for view in solution.views])
    axes = np.linalg.svd(normals)[2]
    around = np.arctan2(normals @ axes[1:].T, np.abs(normals @ axes[:1].T))
    narrow, wide = np.degrees(sorted(np.ptp(around, axis=0)))
    if wide < _TILTED_DEG:
        words = f"the board's directions differ by {wide:.0f}° at most"
        remedy = "tilt it by 30° to 45° in several pictures, each time another edge towards the camera"
        found.append(Diagnosis("never_tilted", words, remedy))
    elif narrow < _TILTED_DEG:
        words = f"the board is tilted about one axis only: by {wide:.0f}°, about the other by {narrow:.0f}°"
        remedy = "tilt it about the other axis, too: a neighbouring edge towards the camera"
        found.append(Diagnosis("tilted_one_way", words, remedy))
    return found if len(solution.views) >= _FEWEST_VIEWS else []


@dataclass(frozen=True, eq=False)
class SetScores:
    """A solved set of V views, linearised, every view's pose eliminated."""

    names: tuple[str, ...]  # of the views used, in order
    residuals: np.ndarray  # (2N,) px, observed less projected
    # (2N, E) by parameters of a single view: log focal length, cx px, cy px, relative length of the board along its y
    own: np.ndarray
    basis: np.ndarray  # (2N, p) orthonormal, of what the views share: lens and board shape
    bounds: np.ndarray  # (V + 1,) first row of each view
    focal_px: tuple[float, float]  # fx, fy
    variance_px2: float  # of the residuals, per axis

    FOCAL, CENTRE_X, CENTRE_Y = range(3)

    def own_scores(self, parameter: int) -> tuple[np.ndarray, np.ndarray]:
        """Score (V,) of a parameter that each view has to itself, the gradient of the cost, px²; and its information
        (V, V) px², which times the residuals' variance is the score's covariance. What the views share is eliminated.
        """
        column, basis = self.own[:, parameter], self.basis
        left = self.residuals - basis @ (basis.T @ self.residuals)
        starts = self.bounds[:-1]
        shared = np.add.reduceat(basis * column[:, None], starts, axis=0)
        information = np.diag(np.add.reduceat(column**2, starts)) - shared @ shared.T
        return np.add.reduceat(column * left, starts), information


def set_scores(views: Sequence[BoardView], solution: LensSolution, spec: Board | BoardPoints) -> SetScores | None:
    """Linearise a solved set over the good corners of the views used; None where they are too few.

    views : in the order of capture, the solution's among them by name.
    """
    used = {view.name: view for view in solution.views}
    chosen = [view for view in views if view.name in used]
    if len({view.name for view in chosen}) < len(chosen) or len(chosen) < 2:
        return None
    model = LENS_MODELS[solution.model]
    observations = kept_observations(chosen, [used[view.name].outlier_ids for view in chosen], corner_points(spec))
    intrinsics = solution.camera.parameters
    poses = np.array([used[view.name].T_camera_board.vector for view in chosen])
    directions = free_directions(model, square_pixels=bool(intrinsics[0] == intrinsics[1]), shape=True)
    bundle = Bundle(model, intrinsics, poses, directions, shape=solution.board_shape.parameters)
    residuals, by_shared, by_pose, bounds = rows(bundle, observations)
    focal = by_shared[..., :1] * intrinsics[0] + by_shared[..., 1:2] * intrinsics[1]
    own = np.concatenate([focal, by_shared[..., 2:4]], axis=-1)
    every = np.concatenate([by_shared @ directions, own, residuals[..., None]], axis=-1)
    left = without_own(every, by_pose, bounds)
    flat = np.vstack([one[: 2 * count] for one, count in zip(left, np.diff(bounds).tolist(), strict=True)])
    shared = flat[:, : directions.shape[1]]
    norms = np.linalg.norm(shared, axis=0)
    vectors, values, _ = np.linalg.svd(shared[:, norms > 0.0] / norms[norms > 0.0], full_matrices=False)
    basis = vectors[:, values > _OPEN * values[:1]]
    freedom = len(flat) - basis.shape[1] - 6 * len(chosen)
    if freedom <= 0 or not np.isfinite(flat).all():
        return None
    rest = flat[:, -1] - basis @ (basis.T @ flat[:, -1])
    names, focal_px = tuple(view.name for view in chosen), (float(intrinsics[0]), float(intrinsics[1]))
    own = flat[:, directions.shape[1] : -1]
    return SetScores(names, flat[:, -1], own, basis, 2 * bounds, focal_px, float(rest @ rest) / freedom)


def _print_stretched(shape: BoardShape) -> Diagnosis | None:
    """A print whose x and y differ in scale."""
    excess, std = float(shape.parameters[STRETCH]), float(shape.std[STRETCH])
    if abs(excess) < max(_STRETCH_SIGNIFICANT * std, _STRETCH_NOTICEABLE):
        return None
    longer, other = ("x", "y") if excess > 0 else ("y", "x")
    return Diagnosis(
        "print_stretched",
        f"the print is longer along its {longer} than along its {other} by "
        f"{100 * abs(excess):.2f} ± {100 * std:.2f} %; "
        f"the lens was solved with that, but distances are uncertain by {50 * abs(excess):.2f} %",
        "measure both rulers of the print and say so in the board file, or print it anew without scaling",
    )


@dataclass(frozen=True)
class _Change:
    """The pattern over the views that explains most."""

    index: int  # of the pattern
    size: float  # in the parameter's unit
    std: float  # by the scatter of views or residuals
    chance: float  # of one so clear among all tested patterns, were there none


def steps(count: int) -> np.ndarray:
    """(K, V) patterns: 0 before some view, 1 from it on; two views at least on either side."""
    return (np.arange(count) >= np.arange(_SIDE_VIEWS, count - _SIDE_VIEWS + 1)[:, None]).astype(float)


def find_change(
    score: np.ndarray, information: np.ndarray, patterns: np.ndarray, variance_px2: float
) -> _Change | None:
    """The pattern (K, V) that a parameter's values over the views follow best, by `SetScores.own_scores`; None with too
    few views. Its chance is by drawing: the scatter of the views about the pattern sets the scale, not the corners'
    noise, for a board that is not flat moves whole views.
    """
    if len(score) < _CHANGE_VIEWS:
        return None
    values, vectors = np.linalg.eigh(information)
    kept = values > _OPEN * max(float(values[-1]), 1e-300)
    root = np.sqrt(values[kept])
    # independent, of the residuals' variance
    white, score = (vectors[:, kept] * root).T, (vectors[:, kept] / root).T @ score
    shapes = patterns @ white.T
    strength = np.linalg.norm(shapes, axis=1)
    seen = strength > 1e-9 * max(float(np.linalg.norm(white)), 1e-300)
    freedom = len(score) - 1
    if not seen.any() or freedom < _CHANGE_VIEWS - 2:
        return None
    shapes = shapes[seen] / strength[seen, None]
    share = _shares(shapes, score[None])[0]
    best = int(share.argmax())
    left = float(score @ score) * (1.0 - share[best]) / freedom
    size = float(shapes[best] @ score / strength[seen][best])
    std = float(np.sqrt(max(left, variance_px2)) / strength[seen][best])
    # the bound by the residuals' variance alone; where that is no small chance, the scatter need not be drawn
    chance = min(1.0, 2.0 * len(shapes) * float(ndtr(-abs(size / std))))
    if chance < 0.1:
        count = min(_DRAWS, _MOST_NUMBERS // shapes.shape[1])
        draws = np.random.default_rng(_SEED).standard_normal((count, shapes.shape[1]))
        exceeded = (_shares(shapes, draws).max(axis=1) >= share[best]).sum()
        chance = max((1 + exceeded) / (1 + count), chance)
    return _Change(int(np.flatnonzero(seen)[best]), size, std, float(chance))


def _shares(shapes: np.ndarray, scores: np.ndarray) -> np.ndarray:
    """(S, K) share of the squares of scores (S, R) that each unit shape (K, R) explains."""
    return (scores @ shapes.T) ** 2 / np.maximum((scores**2).sum(axis=1, keepdims=True), 1e-300)


def _clear_changes(scores: SetScores, parameter: int, patterns: np.ndarray, least: float) -> list[_Change]:
    """The change of a parameter that is no chance and at least so large, if there is one."""
    change = find_change(*scores.own_scores(parameter), patterns, scores.variance_px2)
    return [change] if change is not None and change.chance < _CHANCE and abs(change.size) > least else []


def clearest_change(scores: SetScores, parameter: int) -> tuple[Literal["step", "single", "creep"], _Change] | None:
    """The change over the views that explains most of a parameter of a view, if one is clear and large enough: from a
    view on, of a single view, or, of the focal length, steady."""
    count, focal = len(scores.names), parameter == SetScores.FOCAL
    patterns: dict[Literal["step", "single", "creep"], np.ndarray] = {"step": steps(count), "single": np.eye(count)}
    if focal:
        patterns["creep"] = np.linspace(0.0, 1.0, count)[None]
    least = _NOTICEABLE * (1.0 if focal else scores.focal_px[parameter - SetScores.CENTRE_X])
    clear = [
        (name, change)
        for name, pattern in patterns.items()
        for change in _clear_changes(scores, parameter, pattern, least)
    ]
    return max(clear, key=lambda one: abs(one[1].size / one[1].std), default=None)


def _focus_changed(scores: SetScores) -> Diagnosis | None:
    """By perspective, that is from tilted views alone: a face-on board that looks larger may be nearer."""
    found, names = clearest_change(scores, SetScores.FOCAL), scores.names
    if found is None:
        return None
    pattern, change = found
    by = f"by {100 * change.size:+.2f} ± {100 * change.std:.2f} %"
    remedy = (
        "switch autofocus and zoom off, fix them with tape, and take the pictures again; or keep those on one side only"
    )
    match pattern:
        case "step":
            name, words = "focus_changed", f"the focal length changes between {_sides(change, names)} {by}"
        case "creep":
            name, words = "focus_crept", f"the focal length creeps {by} from {names[0]} to {names[-1]}"
        case "single":
            name, odd = "odd_view", names[change.index]
            words = f"the focal length of {odd} differs from the other pictures' {by}"
            remedy = f"remove {odd}: it is of another camera or zoom, or was cropped or scaled"
    return Diagnosis(name, words, remedy, "wrong" if abs(change.size) > _GRAVE else "doubt")


def centre_moved(scores: SetScores) -> Diagnosis | None:
    """Whether the picture's centre differs before and after some picture: an image stabiliser, or a cropped mode."""
    axes = ((SetScores.CENTRE_X, ("to the left", "to the right")), (SetScores.CENTRE_Y, ("up", "down")))
    found = [
        (change, sides[change.size > 0])
        for (parameter, sides), focal_px in zip(axes, scores.focal_px, strict=True)
        for change in _clear_changes(scores, parameter, steps(len(scores.names)), _NOTICEABLE * focal_px)
    ]
    if not found:
        return None
    change, direction = min(found, key=lambda one: one[0].chance)
    where = f"between {_sides(change, scores.names)} by {abs(change.size):.1f} ± {change.std:.1f} px {direction}"
    remedy = (
        "switch off image stabilisation and cropping, and check that the lens sits tight; then take the pictures again"
    )
    return Diagnosis("centre_moved", f"the lens' centre moves {where}", remedy, "wrong")


def _sides(step: _Change, names: tuple[str, ...]) -> str:
    first = step.index + _SIDE_VIEWS
    return f"{names[first - 1]} and {names[first]}"


def view_set_diagnoses(
    views: Sequence[BoardView], solution: LensSolution, spec: Board | BoardPoints
) -> list[Diagnosis]:
    """Faults of the set, the grave ones first; views : in the order of capture, unused ones among them."""
    names = {view.name for view in solution.views}
    used = [view for view in views if view.name in names]
    if not used:
        return []
    scores = set_scores(used, solution, spec)
    judged = [] if scores is None else [_focus_changed(scores), centre_moved(scores)]
    if scores is not None and not any(judged):
        # a lens that did not stay the same shifts the print's aspect by several of its standard deviations
        judged.append(_print_stretched(solution.board_shape))
    found = [one for one in (*judged, _poorly_covered(used, spec)) if one is not None]
    return sorted([*found, *_little_variety(used, solution, spec)], key=lambda one: not one.grave)
