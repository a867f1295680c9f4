"""What the synthetic calibrations share: lenses, the board, noisy views of it, and the error of a lens in mm on C."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from targets.board import BoardSpec, corner_points
from vbaa_calib.calibrate.lens.bundle import BoardCorners, Bundle, refine
from vbaa_calib.calibrate.lens.models import LENS_MODELS, DistortionModel, camera_of
from vbaa_calib.camera import Camera
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Pose

BOARD = BoardSpec(squares_x=11, squares_y=8, square_m=0.015, marker_m=0.011)
HD, SQUARE, TALL, VGA = (1280, 720), (2048, 2048), (1280, 960), (640, 480)
MILD = np.array([900.0, 902.0, 645.0, 352.0, -0.12, 0.04, 4e-4, -3e-4, 0.0])
LONG = np.array([2800.0, 2804.0, 1015.0, 1032.0, -0.08, 0.15, 2e-4, 3e-4, 0.0])
WIDE = np.array([590.0, 591.0, 641.0, 356.2, 0.31, 0.025, 4e-4, -3e-4, 1e-3, 0.56, 0.061, 5e-3])
FISHEYE = np.array([420.0, 421.0, 641.0, 478.0, 0.05, -0.01, 0.003, -0.001])
"""fx, fy, cx, cy and distortion in OpenCV's order; five coefficients, eight (WIDE), or its fisheye's four."""
_CORNER_PX = 0.15
"""Standard deviation of a corner, per axis."""
_OUTLIER_PX = (2.0, 20.0)
_LEAST_COSINE = 0.1
"""Of the angle off the axis: a corner further out is not seen."""
SCATTERED, MARKER, SWAPPED, MIRRORED, ROW, VIEW = FAULTS = "scattered", "marker", "swapped", "mirrored", "row", "view"
"""How gross errors come: each corner on its own, or in groups."""
_PATCH = (3, 4)
"""Corners along a side of what a reflection mirrors, fewest and most."""
_TRIES = 50


@dataclass(frozen=True, eq=False)
class Corners:
    """All corners of a board, row by row: pixels (C, 2), ids (rows, columns), which are seen (C,)."""

    pixels: np.ndarray
    ids: np.ndarray
    seen: np.ndarray

    def some(self, height: int, width: int, rng: np.random.Generator) -> np.ndarray:
        """(height, width) ids of corners side by side."""
        row, column = (rng.integers(size - own + 1) for size, own in zip(self.ids.shape, (height, width), strict=True))
        return self.ids[row : row + height, column : column + width]

    def fault(
        self, kind: str, sizes_px: tuple[float, float], rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Ids (n,) of corners that are wrong together, and where they are seen instead (n, 2)."""
        if kind == MARKER:  # misread: the four corners around it are shifted together
            ids = self.some(2, 2, rng).ravel()
            return ids, self.pixels[ids] + shifts(1, sizes_px, rng)
        if kind == SWAPPED:  # two ids are exchanged
            ids = rng.choice(np.flatnonzero(self.seen), 2, replace=False)
            return ids, self.pixels[ids[::-1]]
        if kind == MIRRORED:  # a reflection: a patch is seen mirrored, where it is; its middle column stays
            height, width = rng.integers(_PATCH[0], np.minimum(self.ids.shape, _PATCH[1]) + 1).tolist()
            patch = self.some(height, width, rng)
            return patch.ravel(), self.pixels[patch[:, ::-1].ravel()]
        if kind == ROW:  # counted from a wrong marker: all its corners are one square off
            ids = self.some(1, self.ids.shape[1], rng)[0]
            own = self.pixels[ids]
            return ids, np.vstack([own[1:], 2.0 * own[-1] - own[-2]])
        # all ids are wrong: mirrored, or in any order
        ids, mirrored = np.flatnonzero(self.seen), self.ids[:, ::-1].ravel()[self.seen]
        others = mirrored if self.seen[mirrored].all() and rng.random() < 0.5 else rng.permutation(ids)
        return ids, self.pixels[others]


def shifts(count: int, sizes_px: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
    """(count, 2) in any direction; sizes over a decade or more are drawn with uniform logarithms."""
    angle, (least, most) = rng.uniform(0, 2 * np.pi, count), sizes_px
    wide = most > 10.0 * least
    length = np.exp(rng.uniform(np.log(least), np.log(most), count)) if wide else rng.uniform(least, most, count)
    return length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def spoilt(
    corners: Corners, kind: str, share: float, sizes_px: tuple[float, float], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (C, 2) of which a share, in the mean, is wrong; which are (C,). sizes_px : least and largest shift."""
    count, moved = int(corners.seen.sum()), corners.pixels.copy()
    if kind == SCATTERED:
        chosen, by = rng.random(count) < share, shifts(count, sizes_px, rng)
        moved[np.flatnonzero(corners.seen)[chosen]] += by[chosen]
        return moved, np.any(moved != corners.pixels, axis=1)
    left = rng.binomial(count, share)
    for _ in range(_TRIES):
        ids, where = corners.fault(kind, sizes_px, rng)
        # the last one as often as makes the share right
        if rng.random() * len(ids) >= left:
            break
        if not np.any(moved[ids] != corners.pixels[ids]):
            moved[ids] = where
            left -= int((corners.seen[ids] & np.any(where != corners.pixels[ids], axis=1)).sum())
    return moved, np.any(moved != corners.pixels, axis=1)


def bent_corners(sagittas_m: tuple[float, float], twist_m: float = 0.0, spec: BoardSpec = BOARD) -> np.ndarray:
    """(C, 3) corners of a board bent by so much along its two axes and twisted, in its frame."""
    points = corner_points(spec)
    u, v = (2.0 * (points - points.min(axis=0))[:, :2] / np.ptp(points, axis=0)[:2] - 1.0).T
    # not by what the solve takes for it
    rise = sagittas_m[0] * (u**2 - 1.0 / 3.0) + sagittas_m[1] * (v**2 - 1.0 / 3.0) + twist_m * u * v
    return points + rise[:, None] * np.array([0.0, 0.0, 1.0])


def noisy_view(
    name: str, ids: np.ndarray, pixels: np.ndarray, size: tuple[int, int], outliers: float, rng: np.random.Generator
) -> tuple[BoardView, np.ndarray]:
    """A view of corners (N,) at true pixels (N, 2), a share of them 2 to 20 px off, and which (N,) are not."""
    noisy = pixels + _CORNER_PX * rng.normal(size=pixels.shape)
    seen = Corners(noisy, np.arange(len(ids))[None], np.ones(len(ids), bool))
    noisy, wrong = spoilt(seen, SCATTERED, outliers, _OUTLIER_PX, rng)
    return BoardView(name, ids, noisy, size, np.arange(40)), ~wrong


@dataclass(frozen=True, eq=False)
class Rig:
    """A camera, how a board is shown to it, and what is wrong with the board and with its corners.

    lens : name of the true lens model. intrinsics : (4 + k,) its true parameters.
    views : how many. outliers : share of the corners that are grossly wrong, outlier_px : by so much. faults : how
        they hang together, of `FAULTS`.
    sagittas_m, twist_m : bend of the board along x and y, rise of its corners (1, 1), (-1, -1) above the other two.
    stretch : by how much the print is too long along x and y, shear : by how much its y leans towards x.
    spec : the board. fill : share of the picture that it fills, 1 for about half.
    noise_px : standard deviation of a corner, per axis; of each view its own by a factor whose logarithm has the
        deviation blur. tails : degrees of freedom of Student's t, of the same deviation; infinite for normal noise.
    motion_px : standard deviation of what the board moves while a view is read out, from its first row to its last.
    """

    name: str
    lens: str
    image_size: tuple[int, int]
    intrinsics: np.ndarray
    views: int
    outliers: float = 0.0
    sagittas_m: tuple[float, float] = (0.0, 0.0)
    faults: str = SCATTERED
    outlier_px: tuple[float, float] = _OUTLIER_PX
    twist_m: float = 0.0
    stretch: tuple[float, float] = (0.0, 0.0)
    shear: float = 0.0
    spec: BoardSpec = BOARD
    fill: float = 1.0
    noise_px: float = _CORNER_PX
    blur: float = 0.0
    tails: float = np.inf
    motion_px: float = 0.0

    @property
    def model(self) -> DistortionModel:
        """The true lens model."""
        return LENS_MODELS[self.lens]

    @property
    def camera(self) -> Camera:
        """The true camera."""
        return camera_of(self.model, self.intrinsics, self.image_size)

    @property
    def board_points_m(self) -> np.ndarray:
        """(C, 3) corners as the board truly has them, in its frame."""
        x, y, rise = bent_corners(self.sagittas_m, self.twist_m, self.spec).T
        along, across = self.stretch
        return np.column_stack([x * (1.0 + along) + self.shear * y, y * (1.0 + across), rise])


@dataclass(frozen=True, eq=False)
class Draw:
    """One set of noisy views of a rig, with the truth.

    poses : (V, 6) true rotation vectors rad and translations m of the board's frame.
    good : per view (N,), which corners are no outliers.
    """

    rig: Rig
    views: list[BoardView]
    poses: np.ndarray
    good: list[np.ndarray]


def rigs() -> list[Rig]:
    """The five rigs of the published comparison."""
    return [
        Rig("f 900, mild barrel, 25 views", "opencv5", HD, MILD, 25),
        Rig("f 2800, 22 views", "opencv5", SQUARE, LONG, 22),
        Rig("wide rational f 590, 20 views", "rational", HD, WIDE, 20),
        Rig("f 900, 8 views", "opencv5", HD, MILD, 8),
        Rig("f 900, 5 % outliers, bowed 0.5 mm", "opencv5", HD, MILD, 25, 0.05, (5e-4, 0.0)),
    ]


def draw(rig: Rig, seed: int) -> Draw:
    """Views of a rig, their noise, poses and outliers all from the seed."""
    rng = np.random.default_rng(seed)
    found, points, poses = Draw(rig, [], np.empty((0, 6)), []), rig.board_points_m, list[np.ndarray]()
    ids = np.arange(len(points)).reshape(-1, rig.spec.squares_x - 1)
    # of views that are wrong as a whole there is one at least
    wrong_views = max(1, round(rig.outliers * rig.views)) if rig.outliers and rig.faults == VIEW else 0
    wholly = rng.permutation(rig.views)[:wrong_views] if wrong_views else ()
    while len(found.views) < rig.views:
        pose = _pose(rig, rng)
        space = pose @ points
        pixels = rig.camera.project(space)[0]
        ahead = space[:, 2] > _LEAST_COSINE * np.linalg.norm(space, axis=1)
        seen = ahead & np.all((pixels > 0) & (pixels < np.array(rig.image_size) - 1), axis=1)
        if seen.sum() < min(20, 0.6 * len(points)):
            continue
        noisy = pixels + _noise(rig, pixels.shape, seen, rng)
        if rig.motion_px:
            noisy += rig.motion_px * rng.normal(size=2) * pixels[:, 1:] / rig.image_size[1]
        share = rig.outliers if rig.faults != VIEW else float(len(found.views) in wholly)
        noisy, wrong = spoilt(Corners(noisy, ids, seen), rig.faults, share, rig.outlier_px, rng)
        # what a fault puts beside the picture is not seen
        there = np.flatnonzero(seen & np.all((noisy > -0.5) & (noisy < np.array(rig.image_size) - 0.5), axis=1))
        markers = np.arange(min(40, rig.spec.marker_count))
        found.views.append(BoardView(f"{len(poses):02d}.png", there, noisy[there], rig.image_size, markers))
        found.good.append(~wrong[there])
        poses.append(pose.vector)
    return replace(found, poses=np.array(poses))


def _noise(rig: Rig, shape: tuple[int, ...], seen: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Of the corners that are seen; nil for the others."""
    noise = np.zeros(shape)
    own = rng.normal(size=noise[seen].shape)
    if np.isfinite(rig.tails):
        own /= np.sqrt(rng.chisquare(rig.tails, len(own)) / (rig.tails - 2.0))[:, None]
    noise[seen] = rig.noise_px * own * (np.exp(rig.blur * rng.normal()) if rig.blur else 1.0)
    return noise


def _pose(rig: Rig, rng: np.random.Generator) -> Pose:
    """The board tilted by up to 40°, filling about half of the picture, its middle anywhere in it.

    A fisheye is shown the board facing it wherever it is, as one holds it who watches the picture.
    """
    centre, extent = corner_points(rig.spec).mean(axis=0), (rig.spec.squares_x - 2) * rig.spec.square_m
    width, height = rig.image_size
    distance = rng.uniform(0.9, 1.5) * extent * rig.intrinsics[0] / (0.6 * width) / rig.fill
    direction = rng.uniform(0, 2 * np.pi)
    axis = np.array([np.cos(direction), np.sin(direction), 0.0])
    tilt = Pose.from_rotvec(rng.uniform(0.3, 1.0) * np.radians(40.0) * axis, np.zeros(3))
    rotation = (tilt @ Pose.from_rotvec(np.array([0.0, 0.0, rng.uniform(-0.6, 0.6)]), np.zeros(3))).rotation
    offset = rng.uniform(-0.33, 0.33, 2) * np.array([width, height]) / rig.intrinsics[0]
    if rig.model.camera_model != "fisheye":
        return Pose(rotation, distance * np.array([*offset, 1.0]) - rotation @ centre)
    angle = 1.2 * np.hypot(*offset)
    across = np.array([-offset[1], offset[0], 0.0]) * angle / np.hypot(*offset)
    turned = Pose.from_rotvec(across, np.zeros(3)).rotation
    return Pose(turned @ rotation, turned @ (distance * np.array([0.0, 0.0, 1.0]) - rotation @ centre))


_SIDES_M, _GRID = (0.24, 0.12), (13, 7)
_T_CAMERA_PLANE = Pose.from_rotvec(np.array([0.0, np.radians(35.0), 0.0]), np.array([0.0, 0.0, 0.4]))
"""Plane C: 240 x 120 mm at 0.4 m, tilted by 35°."""
_NOWHERE_M = 0.1
"""What a pixel counts that has no ray, and the most that any does."""


def error_mm(camera: Camera, truth: Camera, from_jig: bool = False) -> float:
    """Rms distance on C between points and where the camera puts their pixels, mm.

    The pose of C is the true one; with `from_jig` it is solved with this camera from the same points without noise, as
    a board in the jig gives it, which takes up much of a lens' error. Points outside the true picture do not count; a
    pixel that has no ray counts as 100 mm.
    """
    return rms_on_plane_mm(camera, *seen_on_plane(truth, camera if from_jig else None))


def seen_on_plane(truth: Camera, solved_by: Camera | None = None) -> tuple[Pose, np.ndarray, np.ndarray]:
    """T_camera_plane of C, the points (M, 2) m on it that the picture shows, and their pixels (M, 2).

    solved_by : a camera by which the pose is solved from these points; without it, it is the true one.
    """
    x, y = (np.linspace(-0.5, 0.5, count) * side for count, side in zip(_GRID, _SIDES_M, strict=True))
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    pixels, valid = truth.project(_T_CAMERA_PLANE @ on_plane(points))
    inside = valid & truth.in_picture(pixels)
    points, pixels = points[inside], pixels[inside]
    found = solved_by and pose_by(solved_by, _T_CAMERA_PLANE, BoardCorners(on_plane(points), pixels))
    return found or _T_CAMERA_PLANE, points, pixels


def on_plane(points_m: np.ndarray) -> np.ndarray:
    """(M, 3) points (M, 2) of a plane in its frame."""
    return np.column_stack([points_m, np.zeros(len(points_m))])


def rms_on_plane_mm(camera: Camera, T_camera_plane: Pose, points_m: np.ndarray, pixels: np.ndarray) -> float:
    """Rms distance between points (M, 2) on a plane and where the camera puts their pixels (M, 2), 100 mm at most."""
    off = np.linalg.norm(offsets_on_plane_m(camera, T_camera_plane, points_m, pixels), axis=1)
    return 1e3 * float(np.sqrt(np.mean(off**2)))


def offsets_on_plane_m(camera: Camera, T_camera_plane: Pose, points_m: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """(M, 2) from points (M, 2) on a plane to where the camera puts their pixels (M, 2), 0.1 m long at most."""
    rays, seen = camera.unproject(pixels)
    normal, origin = T_camera_plane.rotation[:, 2], T_camera_plane.translation_m
    with np.errstate(all="ignore"):
        hits = rays * ((normal @ origin) / (rays @ normal))[:, None]
    off = (hits - origin) @ T_camera_plane.rotation[:, :2] - points_m
    off[~seen | ~np.isfinite(off).all(axis=1)] = _NOWHERE_M, 0.0
    return off * np.minimum(_NOWHERE_M / np.maximum(np.linalg.norm(off, axis=1), _NOWHERE_M), 1.0)[:, None]


def pose_by(camera: Camera, start: Pose, board: BoardCorners) -> Pose:
    """T_camera_board as this camera has it, by corners exactly seen."""
    model = DistortionModel("any", camera.model, len(camera.distortion), (), None)
    pose = refine(Bundle.start(model, camera.parameters, start.vector[None]).poses_only, [board]).poses[0]
    return Pose.from_rotvec(pose[:3], pose[3:])
