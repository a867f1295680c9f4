"""Diagnosis of the board's pictures: changes between them, the print, coverage and variety of poses; one picture
compared with earlier ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import cv2
import numpy as np

from targets.board import AprilGrid, Board, BoardPoints, BoardSpec, corner_points
from vbaa_calib.calibrate.lens.board_shape import STRETCH, BoardShape
from vbaa_calib.calibrate.lens.bundle import BoardCorners, Bundle, free_directions, rows
from vbaa_calib.calibrate.lens.choice import kept_observations
from vbaa_calib.calibrate.lens.initialization import homography
from vbaa_calib.calibrate.lens.intrinsics import LensSolution
from vbaa_calib.calibrate.lens.models import LENS_MODELS
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.core.least_squares import without_own
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.detect.board.view_quality import fixes_homography
from vbaa_calib.detect.quality.settings import QualitySettings
from vbaa_calib.geometry import Pose

from .decision import DecisionSettings, Explanation, diagnose


@dataclass(frozen=True)
class _BoardSettings:
    """Thresholds from which something about the board's pictures is reported."""

    same_shape: float = 0.01  # relative difference of width and height up to which a picture is scaled, not cropped
    moved_squares: float = 0.5  # a board that moved by fewer of its squares is in the same place
    reshaped: float = 0.006  # change of its outline, rms per extent, below which it is tilted as before, to about 6°
    fewest_views: int = 5  # that are diagnosed for repeated poses and missing tilts
    tilted_deg: float = 15.0  # spread of the board's directions that counts as tilted
    least_hull: float = 0.5  # part of the picture within the hull of all corners
    repeated: float = 0.5  # part of the views that may repeat a pose
    open: float = 1e-9  # share of a singular value below which a direction is open
    change_views: int = 6  # fewest views that show a change between them
    side_views: int = 2  # fewest views on either side of a change
    focal_std: float = 0.01  # prior standard deviation of a change: of the focal length, relative, and of the centre
    noticeable: float = 1e-3  # change of the focal length, relative, or of the centre over it, that matters
    grave: float = 3e-3  # change of the focal length from which the pictures must not be used together
    stretch_std: float = 5.0  # standard deviations of the print's stretch from which it is reported
    stretch: float = 2e-3  # stretch that matters
    gap_std: float = 0.02  # prior standard deviation of an AprilGrid's spacing, in tags
    gap: float = 1e-3  # error of the spacing that matters
    grave_gap: float = 5e-3  # from which the board's size is not known
    glass_std_m: float = 5e-3  # prior standard deviation of a plate's thickness before the board
    glass_index: float = 1.5  # of refraction, of glass and acrylic
    glass_m: float = 5e-4  # thickness that matters: it shifts the board by a third
    rectified: float = 0.1  # share of a file's distortion that pictures may have and be rectified, or lack and be raw
    gross: float = 5.0  # scatters beyond which a corner is wrong under both
    corner_px: float = 0.02  # scatter per axis that is no smaller in any picture
    alike: float = 4.0  # corners that share one error, as far as bending goes


_LIMITS = _BoardSettings()


def resolution_changed(size: tuple[int, int], first: tuple[int, int]) -> Diagnosis | None:
    """Diagnosis of a picture of another `size` (width, height) px than the first one; None where they agree."""
    if tuple(size) == tuple(first):
        return None
    wide, high = size[0] / first[0], size[1] / first[1]
    remedy = "set the camera to the mode of the first picture, or begin anew in this one: the lens is another for it"
    if (size[1], size[0]) == tuple(first):
        name, cause = "picture_turned", "width and height are exchanged"
        remedy = "hold the camera as before, and switch off that pictures are turned upright"
    elif abs(wide - high) < _LIMITS.same_shape * high:
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
    """The nearest earlier view with (nearly) the same pose of the board; None without one."""
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
    """Rms distance, px, of the corners common to both views where their poses count as the same; else None."""
    ids, mine, theirs = np.intersect1d(view.ids, other.ids, return_indices=True)
    if len(ids) < QualitySettings.least_corners or 2 * len(ids) < max(len(view.ids), len(other.ids)):
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
    same = moved_px < _LIMITS.moved_squares * square_px and reshaped_px < _LIMITS.reshaped * 2.0 * extent_px
    return moved_px if same else None


def _poorly_covered(views: Sequence[BoardView], spec: Board | BoardPoints) -> Diagnosis | None:
    """Diagnosis of corners that leave out much of the picture, naming the picture's corners that are not covered; None
    where they cover it. views : at least one."""
    size, pixels = np.array(views[0].image_size), np.concatenate([view.corners_px for view in views])
    hull = float(cv2.contourArea(cv2.convexHull(pixels.astype(np.float32)))) / size.prod() if len(pixels) > 2 else 0.0
    column, row = np.clip((pixels + 0.5) / size * (4, 3), 0, (3, 2)).astype(int).T
    places = {"upper left": (0, 0), "upper right": (3, 0), "lower left": (0, 2), "lower right": (3, 2)}
    empty = [name for name, (x, y) in places.items() if not ((column == x) & (row == y)).any()]
    if hull >= _LIMITS.least_hull and len(empty) < 2:
        return None
    where = f", none in the {', '.join(empty)}" if empty else ""
    return Diagnosis(
        "border_empty",
        f"the corners reach over {100 * hull:.0f} % of the picture{where}",
        f"show the board in the {empty[0] if empty else 'picture’s corners'}"
        + (", also partly outside" if isinstance(spec, BoardSpec | AprilGrid) else ""),
    )


def _little_variety(views: Sequence[BoardView], solution: LensSolution, spec: Board | BoardPoints) -> list[Diagnosis]:
    """Diagnosis of repeated poses, and of boards that are never tilted, or about one axis only."""
    found: list[Diagnosis] = []
    kept: list[BoardView] = []
    for view in views:
        if all(_apart_px(view, other, spec) is None for other in kept):
            kept.append(view)
    if len(views) - len(kept) >= _LIMITS.repeated * len(views):
        words = f"{len(views)} pictures show the board in {len(kept)} poses only"
        remedy = "one picture of each pose is enough: turn and move the board between them"
        found.append(Diagnosis("same_poses", words, remedy))
    # boards whose normals hardly spread, or along one line only
    normals = np.array([view.T_camera_board.rotation[:, 2] for view in solution.views])
    axes = np.linalg.svd(normals)[2]
    around = np.arctan2(normals @ axes[1:].T, np.abs(normals @ axes[:1].T))
    narrow, wide = np.degrees(sorted(np.ptp(around, axis=0)))
    if wide < _LIMITS.tilted_deg:
        words = f"the board's directions differ by {wide:.0f}° at most"
        remedy = "tilt it by 30° to 45° in several pictures, each time another edge towards the camera"
        found.append(Diagnosis("never_tilted", words, remedy))
    elif narrow < _LIMITS.tilted_deg:
        words = f"the board is tilted about one axis only: by {wide:.0f}°, about the other by {narrow:.0f}°"
        remedy = "tilt it about the other axis, too: a neighbouring edge towards the camera"
        found.append(Diagnosis("tilted_one_way", words, remedy))
    return found if len(solution.views) >= _LIMITS.fewest_views else []


def _print_stretched(shape: BoardShape) -> Diagnosis | None:
    """Diagnosis of a print with different scales along x and y."""
    excess, std = float(shape.parameters[STRETCH]), float(shape.std[STRETCH])
    if abs(excess) < max(_LIMITS.stretch_std * std, _LIMITS.stretch):
        return None
    longer, other = ("x", "y") if excess > 0 else ("y", "x")
    return Diagnosis(
        "print_stretched",
        f"the print is longer along its {longer} than along its {other} by "
        f"{100 * abs(excess):.2f} ± {100 * std:.2f} %; "
        f"the lens was solved with that, but distances are uncertain by {50 * abs(excess):.2f} %",
        "measure both rulers of the print and say so in the board file, or print it anew without scaling",
    )


LensReadings = tuple[Camera, Camera | None, Sequence[BoardView], np.ndarray]
"""A lens from a file; the other one that the file holds, of rectified pictures or of raw ones; views of a flat board;
its corners (K, 3) m by id."""


def lens_reading_diagnoses(data: LensReadings) -> list[Diagnosis]:
    """Hypotheses that pictures of a board are rectified although a file's lens is that of raw ones, or the other way
    round."""
    return diagnose(data, (_rectified_already, _not_rectified))


def _rectified_already(data: LensReadings) -> Iterator[Explanation[LensReadings]]:
    """Hypothesis of rectified pictures: straight lines are straight in them, and the file's distortion would bend
    them."""
    camera, other, *_ = data
    if not camera.distortion.any():
        return
    share, without_px, with_px, odds = _bend(data, camera)
    if not abs(share) < _LIMITS.rectified:
        return
    words = (
        f"the pictures are rectified already: the board's corners lie on straight lines to {without_px:.2g} px, and to "
        f"{with_px:.2g} px by the lens's distortion, which is of raw pictures (fx {camera.matrix[0, 0]:.1f} px)"
    )
    remedy = "take the raw pictures, or write the matrix that they were rectified with, without distortion, into a file"
    if other is not None:
        words += f"; its projection matrix is of rectified ones (fx {other.matrix[0, 0]:.1f} px)"
        remedy = "give --rectified (vbaa convert FILE --rectified -o camera.json), or take the raw pictures"
    found = Diagnosis("pictures_rectified", words, remedy, "wrong")
    yield Explanation(found, odds, lambda: (other or camera, None, *data[2:]))


def _not_rectified(data: LensReadings) -> Iterator[Explanation[LensReadings]]:
    """Hypothesis of raw pictures: straight lines are bent by the file's distortion, which --rectified removes."""
    camera, other, *_ = data
    if other is None or camera.distortion.any():
        return
    share, without_px, with_px, odds = _bend(data, other)
    if not abs(share - 1.0) < _LIMITS.rectified:
        return
    words = (
        f"the pictures are not rectified: the board's corners lie on straight lines to {without_px:.2g} px, and to "
        f"{with_px:.2g} px by the file's distortion, which is of raw pictures (fx {other.matrix[0, 0]:.1f} px, "
        f"{camera.matrix[0, 0]:.1f} px of rectified ones)"
    )
    remedy = "leave --rectified out, or take the rectified pictures"
    found = Diagnosis("pictures_not_rectified", words, remedy, "wrong")
    yield Explanation(found, -odds, lambda: (other, None, *data[2:]))


def _bend(data: LensReadings, camera: Camera) -> tuple[float, float, float, float]:
    """Fraction of the lens's distortion that the board's straight lines have in the pictures, by least squares; the
    corners' scatter about homographies without distortion and with all of it, px per axis; the log odds of none against
    all."""
    freedom, sums = 0, np.zeros((2, 2))
    for view in data[2]:
        plane = data[3][view.ids, :2]
        if len(plane) < QualitySettings.least_corners or not fixes_homography(plane):
            continue
        ideal, valid = camera.unproject_normalized(view.corners_px)
        straight = np.where(valid[:, None], ideal * np.diag(camera.matrix)[:2] + camera.matrix[:2, 2], np.nan)
        fits = [(pixels, homography(plane, pixels)) for pixels in (view.corners_px, straight)]
        left = np.array(
            [pixels - cv2.perspectiveTransform(plane[None], fit[0])[0] for pixels, fit in fits if fit is not None]
        )
        noise = [fit[1] for _, fit in fits if fit is not None]
        if len(noise) < 2:
            continue
        size = np.linalg.norm(left, axis=2)
        good = np.nanmin(size, axis=0, initial=np.inf) < _LIMITS.gross * max(*noise, _LIMITS.corner_px)
        good &= np.isfinite(size).all(axis=0)
        sums += np.einsum("kni,lni->kl", left[:, good], left[:, good])
        freedom += max(2 * int(good.sum()) - 8, 0)
    if not freedom:
        return np.nan, 0.0, 0.0, 0.0
    # with a share s of the distortion taken out, (1 − s) of the first and s of the second are left
    curve = sums[0, 0] + sums[1, 1] - 2.0 * sums[0, 1]
    share = (sums[0, 0] - sums[0, 1]) / curve if curve > 0.0 else np.nan
    without, whole = np.diag(sums) / freedom + _LIMITS.corner_px**2
    odds = 0.5 * freedom / _LIMITS.alike * float(np.log(whole / without))
    return float(share), float(np.sqrt(without)), float(np.sqrt(whole)), odds


@dataclass(frozen=True)
class _ViewChange:
    """A pattern over the views that a view-wise parameter follows."""

    pattern: Literal["step", "single", "creep"]
    first: int  # index of the view from which on it is so, or of the single one
    size: float  # in the parameter's unit
    std: float  # by the scatter of views or residuals
    log_odds: float  # of the evidence for it, all places of the pattern counted


def _find_change(
    score: np.ndarray, information: np.ndarray, patterns: np.ndarray, variance_px2: float, prior_std: float
) -> tuple[int, float, float, float] | None:
    """The pattern of (K, V) that a parameter's values over the views follow best, with size, standard deviation and
    log odds against no change; None with too few views.

    The scatter of the views about the pattern sets the scale, not the corners' noise alone, for a board that is not
    flat moves whole views: the evidence is Student's.
    """
    freedom = np.linalg.matrix_rank(information, rtol=_LIMITS.open, hermitian=True) - 1
    along = np.einsum("kv,vw,kw->k", patterns, information, patterns)
    seen = np.flatnonzero(along > 1e-18 * max(float(np.trace(information)), 1e-300))
    if len(score) < _LIMITS.change_views or freedom < _LIMITS.change_views - 2 or not len(seen):
        return None
    sizes = patterns[seen] @ score / along[seen]
    whole = float(score @ np.linalg.pinv(information, rcond=_LIMITS.open, hermitian=True) @ score)
    left = (whole - sizes**2 * along[seen]) / freedom
    std = np.sqrt(np.maximum(left, variance_px2) / along[seen])
    gained = 0.5 * (freedom + 1) * np.log1p((sizes / std) ** 2 / freedom)
    odds = gained - np.log(np.maximum(prior_std / std, 1.0)) - np.log(len(seen))
    best = int(odds.argmax())
    return int(seen[best]), float(sizes[best]), float(std[best]), float(odds[best])


@dataclass(frozen=True, eq=False)
class ViewSet:
    """A solved set of V views, linearised, with every view's pose eliminated."""

    names: tuple[str, ...]  # of the views used, in order
    residuals: np.ndarray  # (2N,) px, observed less projected
    own: np.ndarray  # (2N, 3) by parameters of a single view: log focal length, cx px, cy px
    by_gap: np.ndarray  # (2N,) by an AprilGrid's spacing; 0 of other boards
    by_glass: np.ndarray  # (2N,) by the thickness, m, of a plate of glass on the board
    spacing: float  # as described; NaN of other boards
    basis: np.ndarray  # (2N, p) orthonormal, of what the views share: lens and board shape
    bounds: np.ndarray  # (V + 1,) first row of each view
    units: tuple[float, float, float]  # what a relative change of each parameter is counted in: 1, fx, fy
    variance_px2: float  # of the residuals, per axis

    FOCAL, CENTRE_X, CENTRE_Y = range(3)

    @staticmethod
    def of(views: Sequence[BoardView], solution: LensSolution, spec: Board | BoardPoints) -> ViewSet | None:
        """The linearised set over the good corners of the views used; None where there are too few.

        views : in the order of capture, the solution's among them by name.
        """
        used = {view.name: view for view in solution.views}
        chosen = [view for view in views if view.name in used]
        if len({view.name for view in chosen}) < len(chosen) or len(chosen) < 2:
            return None
        model, intrinsics = LENS_MODELS[solution.model], solution.camera.parameters
        seen = kept_observations(chosen, [used[view.name].outlier_ids for view in chosen], corner_points(spec))
        poses = np.array([used[view.name].T_camera_board.vector for view in chosen])
        directions = free_directions(model, square_pixels=bool(intrinsics[0] == intrinsics[1]), shape=True)
        bundle = Bundle(model, intrinsics, poses, directions, shape=solution.board_shape.parameters)
        residuals, by_shared, by_pose, bounds = rows(bundle, seen)
        focal = by_shared[..., :1] * intrinsics[0] + by_shared[..., 1:2] * intrinsics[1]
        by_gap = _by_gap(bundle, seen, spec)[..., None]
        by_glass = _by_moves(bundle, seen, list(map(_behind_glass, poses, seen)))[..., None]
        columns = [by_shared @ directions, focal, by_shared[..., 2:4], by_gap, by_glass, residuals[..., None]]
        every = np.concatenate(columns, axis=-1)
        left = without_own(every, by_pose, bounds)
        flat = np.vstack([one[: 2 * count] for one, count in zip(left, np.diff(bounds).tolist(), strict=True)])
        shared = flat[:, : directions.shape[1]]
        norms = np.linalg.norm(shared, axis=0)
        vectors, values, _ = np.linalg.svd(shared[:, norms > 0.0] / norms[norms > 0.0], full_matrices=False)
        basis = vectors[:, values > _LIMITS.open * values[:1]]
        freedom = len(flat) - basis.shape[1] - 6 * len(chosen)
        if freedom <= 0 or not np.isfinite(flat).all():
            return None
        rest = flat[:, -1] - basis @ (basis.T @ flat[:, -1])
        names, units = tuple(view.name for view in chosen), (1.0, float(intrinsics[0]), float(intrinsics[1]))
        own, by_gap, by_glass = flat[:, directions.shape[1] : -3], flat[:, -3], flat[:, -2]
        spacing = spec.spacing if isinstance(spec, AprilGrid) else np.nan
        variance_px2 = float(rest @ rest) / freedom
        return ViewSet(names, flat[:, -1], own, by_gap, by_glass, spacing, basis, 2 * bounds, units, variance_px2)

    def own_scores(self, parameter: int) -> tuple[np.ndarray, np.ndarray]:
        """Score (V,) of a parameter that may differ from view to view, px², and its information (V, V), px², with
        the shared parameters eliminated."""
        column, basis, starts = self.own[:, parameter], self.basis, self.bounds[:-1]
        left = self.residuals - basis @ (basis.T @ self.residuals)
        shared = np.add.reduceat(basis * column[:, None], starts, axis=0)
        information = np.diag(np.add.reduceat(column**2, starts)) - shared @ shared.T
        return np.add.reduceat(column * left, starts), information

    def clearest(self, parameter: int) -> _ViewChange | None:
        """The change over the views that explains most of a parameter, if it is significant and large enough: from a
        view on, of a single view or, of the focal length, steady."""
        count, side, unit = len(self.names), _LIMITS.side_views, self.units[parameter]
        firsts = np.arange(side, count - side + 1)
        patterns: dict[Literal["step", "single", "creep"], np.ndarray] = {
            "step": (np.arange(count) >= firsts[:, None]).astype(float),
            "single": np.eye(count),
            "creep": np.linspace(0.0, 1.0, count)[None][: int(parameter == self.FOCAL)],
        }
        score, information = self.own_scores(parameter)
        found = []
        for name, pattern in patterns.items():
            change = _find_change(score, information, pattern, self.variance_px2, _LIMITS.focal_std * unit)
            if change is not None and abs(change[1]) > _LIMITS.noticeable * unit:
                index = int(firsts[change[0]]) if name == "step" else change[0]
                found.append(_ViewChange(name, index, *change[1:]))
        best = max(found, key=lambda one: abs(one.size / one.std), default=None)
        return best if best is not None and best.log_odds >= DecisionSettings.least_log_odds else None

    def without(self, parameter: int, change: _ViewChange) -> ViewSet:
        """The set corrected for a change."""
        views, count = np.arange(len(self.names)), len(self.names)
        pattern = {"step": views >= change.first, "single": views == change.first, "creep": views / (count - 1)}
        values = change.size * np.asarray(pattern[change.pattern], float)
        moved = self.own[:, parameter] * np.repeat(values, np.diff(self.bounds))
        return replace(self, residuals=self.residuals - moved)


def _focus_changed(data: ViewSet) -> Iterator[Explanation[ViewSet]]:
    """Hypothesis of a changed focus, by perspective alone, that is by tilted views: a face-on board that looks
    larger may be nearer."""
    change, names = data.clearest(ViewSet.FOCAL), data.names
    if change is None:
        return
    by = f"by {100 * change.size:+.2f} ± {100 * change.std:.2f} %"
    remedy = (
        "switch autofocus and zoom off, fix them with tape, and take the pictures again; or keep those on one side only"
    )
    match change.pattern:
        case "step":
            name, words = "focus_changed", f"the focal length changes between {_sides(change, names)} {by}"
        case "creep":
            name, words = "focus_crept", f"the focal length creeps {by} from {names[0]} to {names[-1]}"
        case "single":
            name, other = "odd_view", names[change.first]
            words = f"the focal length of {other} differs from the other pictures' {by}"
            remedy = f"remove {other}: it is of another camera or zoom, or was cropped or scaled"
    found = Diagnosis(name, words, remedy, "wrong" if abs(change.size) > _LIMITS.grave else "doubt")
    yield Explanation(found, change.log_odds, lambda: data.without(ViewSet.FOCAL, change))


def _centre_moved(data: ViewSet) -> Iterator[Explanation[ViewSet]]:
    """Hypothesis of a principal point that differs before and after some picture: an image stabiliser, or a cropped
    mode."""
    for parameter, sides in ((ViewSet.CENTRE_X, ("to the left", "to the right")), (ViewSet.CENTRE_Y, ("up", "down"))):
        change = data.clearest(parameter)
        if change is None or change.pattern != "step":
            continue
        size = f"{abs(change.size):.1f} ± {change.std:.1f} px {sides[change.size > 0]}"
        words = f"the lens' centre moves between {_sides(change, data.names)} by {size}"
        remedy = "switch off image stabilisation and cropping, and check that the lens sits tight; then take them again"
        without = partial(data.without, parameter, change)
        yield Explanation(Diagnosis("centre_moved", words, remedy, "wrong"), change.log_odds, without)


def _sides(step: _ViewChange, names: tuple[str, ...]) -> str:
    return f"{names[step.first - 1]} and {names[step.first]}"


def _by_gap(bundle: Bundle, seen: Sequence[BoardCorners], spec: Board | BoardPoints) -> np.ndarray:
    """(N, 2) negative derivatives of the corners' residuals by an AprilGrid's spacing; zero for other boards."""
    if not isinstance(spec, AprilGrid):
        return np.zeros((sum(len(view.pixels) for view in seen), 2))
    steps = (np.floor(view.points_m[:, :2] / (spec.tag_m * (1.0 + spec.spacing)) + 1e-6) for view in seen)
    return _by_moves(bundle, seen, [np.pad(spec.tag_m * step, ((0, 0), (0, 1))) for step in steps])


def _by_moves(bundle: Bundle, seen: Sequence[BoardCorners], moves: Sequence[np.ndarray]) -> np.ndarray:
    """(N, 2) negative derivatives of the corners' residuals along moves (N, 3) m of each view's corners."""
    # in the place of the first of the shape's parameters
    others = ((0, 0), (0, 0), (0, len(bundle.shape) - 1))
    views = [replace(view, deformation=np.pad(move[..., None], others)) for view, move in zip(seen, moves, strict=True)]
    flat = replace(bundle, shape=np.zeros_like(bundle.shape))
    return rows(flat, views)[1][..., len(bundle.intrinsics)]


def _behind_glass(pose: np.ndarray, seen: BoardCorners) -> np.ndarray:
    """(N, 3) apparent displacements of a board's corners in its plane, per thickness of a plate of glass on it, by
    Snell's law. pose : (6,) of the board in the camera frame."""
    ways = seen.points_m - Pose.from_rotvec(pose[:3], pose[3:]).inverse().translation_m
    across = np.linalg.norm(ways[:, :2], axis=1) / np.linalg.norm(ways, axis=1)
    straight, bent = (np.tan(np.arcsin(across / index)) for index in (1.0, _LIMITS.glass_index))
    return np.pad(ways[:, :2] * ((straight - bent) / np.linalg.norm(ways[:, :2], axis=1))[:, None], ((0, 0), (0, 1)))


def _other_gap(data: ViewSet) -> Iterator[Explanation[ViewSet]]:
    """Hypothesis of an AprilGrid with another gap between its tags, in sides of a tag, than described."""
    left = data.by_gap - data.basis @ (data.basis.T @ data.by_gap)
    information, freedom = float(left @ left), len(left) - data.basis.shape[1] - 6 * len(data.names) - 1
    if not np.isfinite(data.spacing) or information <= 0.0 or freedom <= 0:
        return
    value = float(left @ data.residuals) / information
    rest = data.variance_px2 * (freedom + 1) - value**2 * information
    std = float(np.sqrt(max(rest, 1e-9 * data.variance_px2) / freedom / information))
    if abs(value) < _LIMITS.gap:
        return
    gained = 0.5 * (freedom + 1) * np.log1p((value / std) ** 2 / freedom)
    measured = f"the gaps between tags measure {data.spacing + value:.4f} ± {std:.4f} of a tag"
    words, remedy = (
        f"{measured}, spacing says {data.spacing:g}",
        "measure a tag and a gap, and correct spacing or tag_m",
    )
    found = Diagnosis("tag_spacing", words, remedy, "wrong" if abs(value) > _LIMITS.grave_gap else "doubt")
    yield Explanation(
        found,
        gained - np.log(max(_LIMITS.gap_std / std, 1.0)),
        lambda: replace(data, residuals=data.residuals - value * data.by_gap, spacing=data.spacing + value),
    )


def _under_glass(data: ViewSet) -> Iterator[Explanation[ViewSet]]:
    """Hypothesis of a board behind glass or acrylic, which bends the rays of tilted boards."""
    left = data.by_glass - data.basis @ (data.basis.T @ data.by_glass)
    score, information = (np.add.reduceat(left * one, data.bounds[:-1]) for one in (data.residuals, left))
    total, freedom = float(information.sum()), len(score) - 1
    if freedom < _LIMITS.change_views - 1 or total <= 0.0:
        return
    value = float(score.sum()) / total
    # corners of one view share errors: the scatter of the views sets the scale
    scatter = float(((score - value * information) ** 2).sum()) * (freedom + 1) / freedom
    std = float(np.sqrt(max(scatter, data.variance_px2 * total))) / total
    if value < _LIMITS.glass_m:
        return
    gained = 0.5 * (freedom + 1) * np.log1p((value / std) ** 2 / freedom)
    size = f"{1e3 * value:.1f} ± {1e3 * std:.1f} mm"
    words = (
        f"the board lies behind {size} of glass or acrylic: its corners are where that would bend their rays to; "
        f"a pose of the board is off by a third of it, {1e3 * value / 3.0:.1f} mm"
    )
    remedy = "take the plate off, or the print out of its frame, and take all pictures of the board again"
    yield Explanation(
        Diagnosis("board_behind_glass", words, remedy, "wrong"),
        gained - np.log(max(_LIMITS.glass_std_m / std, 1.0)),
        lambda: replace(data, residuals=data.residuals - value * data.by_glass),
    )


def view_set_diagnoses(
    views: Sequence[BoardView], solution: LensSolution, spec: Board | BoardPoints
) -> list[Diagnosis]:
    """Diagnoses of the set of views, the grave ones first. views : in the order of capture, including unused ones."""
    names = {view.name for view in solution.views}
    used = [view for view in views if view.name in names]
    if not used:
        return []
    data = ViewSet.of(used, solution, spec)
    found = [] if data is None else diagnose(data, (_focus_changed, _centre_moved, _other_gap, _under_glass))
    # a lens that did not stay the same shifts the print's aspect by several of its standard deviations
    stretched = None if found or data is None else _print_stretched(solution.board_shape)
    found += [one for one in (stretched, _poorly_covered(used, spec)) if one is not None]
    return sorted([*found, *_little_variety(used, solution, spec)], key=lambda one: not one.grave)
