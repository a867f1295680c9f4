"""Uncertainty on plane C from the board pictures so far, by the information matrix of the lens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from targets.board import BoardPoints, BoardWithIds, corner_points
from vbaa_calib.calibrate.lens.board_shape import SHAPE, BoardShape, ShapePrior, deformations
from vbaa_calib.calibrate.lens.bundle import BoardCorners, Bundle, rows
from vbaa_calib.calibrate.lens.choice import kept_observations
from vbaa_calib.calibrate.lens.initialization import robust_poses, widened
from vbaa_calib.calibrate.lens.intrinsics import LensSolution
from vbaa_calib.calibrate.lens.models import LENS_MODELS, DistortionModel, camera_of
from vbaa_calib.calibrate.lens.outliers import usable_views
from vbaa_calib.calibrate.lens.settings import LensSettings
from vbaa_calib.calibrate.lens.uncertainty import pixel_grid
from vbaa_calib.camera import Camera
from vbaa_calib.core.least_squares import without_own
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Pose

from .settings import GuideSettings

# the next richer lens model, by name
_RICHER = {"none": "opencv5", "radial": "opencv5", "opencv4": "opencv5", "opencv5": "rational", "fisheye": "rational"}


@dataclass(frozen=True, eq=False)
class WorkPlane:
    """Estimate of plane C, and the work area on it."""

    T_camera_plane: Pose  # z = 0 is the plane, x runs along the antenna from the clamp
    length_m: float  # of the work area, x from 0 on; y is from minus to plus a part of it

    @staticmethod
    def about(distance_m: float, inclination_rad: float, length_m: float) -> WorkPlane:
        """The assumed plane before the jig is seen: its middle on the optical axis, rotated about the picture's
        vertical."""
        turn = Pose.from_rotvec(np.array([0.0, inclination_rad, 0.0]), np.array([0.0, 0.0, distance_m]))
        to_clamp = Pose(np.eye(3), np.array([-length_m / 2, 0.0, 0.0]))
        return WorkPlane(turn @ to_clamp, length_m)

    @property
    def points(self) -> np.ndarray:
        """(n, 2) x and y, m, of points evenly spread over the work area."""
        columns, rows = GuideSettings.work_grid
        half_width_m = GuideSettings.half_width_per_length * self.length_m
        x, y = np.linspace(0.0, self.length_m, columns), np.linspace(-1.0, 1.0, rows) * half_width_m
        return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)

    @property
    def distance_m(self) -> float:
        """Distance from the camera to the middle of the work area."""
        return float(np.linalg.norm(self.T_camera_plane @ np.array([self.length_m / 2, 0.0, 0.0])))

    def board_pose(self, spec: BoardWithIds) -> Pose:
        """T_camera_board of a board on the plane in the middle of the work area, print up."""
        away = self.T_camera_plane.rotation[:, 2] @ self.T_camera_plane.translation_m >= 0.0
        # the board's z points away from the camera, whatever the plane's does
        turn = np.eye(3) if away else np.diag([1.0, -1.0, -1.0])
        middle = np.array([self.length_m / 2, 0.0, 0.0])
        return self.T_camera_plane @ Pose(turn, middle - turn[:, :2] @ spec.outline_m.mean(axis=0))


@dataclass(frozen=True, eq=False)
class LensInformation:
    """Information on the lens in the pictures so far, about a lens with more parameters than the chosen lens model.

    A simple model from few pictures has too small a covariance: it has none for what it cannot describe. Here the lens
    may also be wrong in what the next richer model could describe, within a prior.
    """

    model: DistortionModel
    intrinsics: np.ndarray  # (4 + k,)
    image_size: tuple[int, int]  # (width, height) px
    scale: np.ndarray  # (4 + k + 5, p) intrinsics and shape for a unit of each z (p,), of prior 0 ± 1
    sigma_px: float  # deviation of a corner, per axis
    shape: np.ndarray  # (5,) of the board
    information: np.ndarray  # (p, p) of z in all pictures, without the prior
    gradient: np.ndarray  # (p,) of the cost by z
    pictures: int = 0  # their number
    solved: bool = False  # whether the lens is a solution, not a nominal lens
    inflation: float = (
        1.0  # factor on deviations, at least 1, by which two halves of the pictures contradict each other
    )
    doubt: str = ""  # why it cannot be enough, in words; empty where nothing is in the way

    @staticmethod
    def of(solution: LensSolution, views: Sequence[BoardView], spec: BoardWithIds) -> LensInformation:
        """Information of the views from which a lens was solved, without their outliers."""
        camera, by_name = solution.camera, {view.name: view for view in views}
        own = [by_name[used.name] for used in solution.views]
        observations = kept_observations(own, [used.outlier_ids for used in solution.views], corner_points(spec))
        poses = np.array([used.T_camera_board.vector for used in solution.views])
        corners = sum(len(view.pixels) for view in observations)
        freedom = 2 * corners - 6 * len(poses) - len(camera.parameter_names)
        sigma_px = max(
            GuideSettings.least_sigma_px, solution.rms_inliers_px * float(np.sqrt(corners / max(freedom, 1)))
        )
        start = _no_pictures(solution.model, camera.parameters, camera.image_size, sigma_px, solution.board_shape)
        chosen = [row for row in solution.comparison if row.model == solution.model and not row.split_half_agrees]
        inflation = max([1.0, *(float(row.halves) for row in chosen[:1] if row.halves is not None)])
        folds = "the lens folds inside the picture: pictures with the board near the border are missing"
        doubt = "" if solution.monotonic else folds
        return replace(start._with(poses, observations), solved=True, inflation=inflation, doubt=doubt)

    @staticmethod
    def nominal(views: Sequence[BoardView], spec: BoardWithIds, image_size: tuple[int, int]) -> LensInformation:
        """Information of views that are too few to solve a lens, about a nominal one."""
        intrinsics, points = nominal_intrinsics(image_size), corner_points(spec)
        start = _no_pictures("radial", intrinsics, image_size, GuideSettings.nominal_sigma_px, BoardShape.flat(points))
        usable = usable_views(views, points, LensSettings.min_corners)[0] if views else []
        if not usable:
            return start
        observations = [BoardCorners(points[view.ids], view.corners_px) for view in usable]
        return start._with(robust_poses(LENS_MODELS["none"], intrinsics, observations), observations)

    def _with(self, poses: np.ndarray, observations: Sequence[BoardCorners]) -> LensInformation:
        """This information and that of views at poses (V, 6)."""
        blocks, gradients = self.view_blocks(poses, observations)
        return replace(
            self,
            information=self.information + blocks.sum(axis=0),
            gradient=self.gradient + gradients.sum(axis=0),
            pictures=self.pictures + len(poses),
        )

    def bundle(self, poses: np.ndarray) -> Bundle:
        """The bundle of this lens with the board at poses (V, 6)."""
        return replace(Bundle.start(self.model, self.intrinsics, poses), shape=self.shape)

    @property
    def camera(self) -> Camera:
        """The camera with this lens, without a covariance."""
        return camera_of(self.model, self.intrinsics, self.image_size)

    @property
    def has_rays(self) -> bool:
        """Whether most pixels have a ray: a lens solved from too few pictures may have hardly any."""
        return bool(self.camera.unproject(pixel_grid(self.image_size))[1].mean() > GuideSettings.least_rays)

    def view_blocks(self, poses: np.ndarray, observations: Sequence[BoardCorners]) -> tuple[np.ndarray, np.ndarray]:
        """Information (V, p, p) and gradient (V, p) of each view at poses (V, 6), with the poses eliminated."""
        residuals, by_shared, by_pose, bounds = rows(self.bundle(np.asarray(poses, float)), observations)
        whole = np.concatenate([by_shared @ self.scale, residuals[..., None]], axis=-1) / self.sigma_px
        count = self.scale.shape[1]
        reduced = without_own(whole, by_pose, bounds)
        blocks = reduced.mT @ reduced
        return blocks[:, :count, :count], blocks[:, :count, count]

    def bias_square(self, sensitivity: np.ndarray) -> float:
        """Mean squared displacement, m², of points (sensitivity (n, 2, p)) on the plane from the chosen to the richer
        lens."""
        step = np.linalg.solve(self.information + np.eye(len(self.information)), self.gradient)
        return float(np.mean(np.sum((sensitivity @ step) ** 2, axis=1)))

    def in_picture(self, points: np.ndarray) -> np.ndarray:
        """(N,) mask of the points (N, 3) m, camera frame, that project into the picture."""
        pixels, valid = self.camera.project(points)
        return valid & self.camera.in_picture(pixels)


def nominal_intrinsics(image_size: tuple[int, int]) -> np.ndarray:
    """(4,) fx, fy, cx, cy of a typical camera, where nothing is known."""
    focal = GuideSettings.nominal_focal_per_width * max(image_size)
    return np.array([focal, focal, (image_size[0] - 1) / 2, (image_size[1] - 1) / 2])


def _no_pictures(
    name: str, intrinsics: np.ndarray, image_size: tuple[int, int], sigma_px: float, board: BoardShape
) -> LensInformation:
    """Information of no picture, about the lens model one richer than `name`, at the solution (4 + k,) of that."""
    chosen, model = LENS_MODELS[name], LENS_MODELS[_RICHER.get(name, name)]
    wide = widened(chosen, intrinsics, model, image_size)
    if chosen.camera_model != model.camera_model and not np.any(wide[4:]):
        model, wide = chosen, np.array(intrinsics, float)
    scale = _prior(model, wide, image_size, board.nominal_m)
    count = scale.shape[1]
    none = np.zeros((count, count)), np.zeros(count)
    return LensInformation(model, wide, image_size, scale, sigma_px, board.parameters, *none)


def _prior(
    model: DistortionModel, intrinsics: np.ndarray, image_size: tuple[int, int], nominal_m: np.ndarray
) -> np.ndarray:
    """Prior standard deviations (`LensInformation.scale`) of the parameters of a typical lens and board."""
    size, unit = len(intrinsics), np.eye(len(intrinsics) + SHAPE)
    fx, fy = intrinsics[:2]
    both, apart = fx * unit[0] + fy * unit[1], fx * unit[0] - fy * unit[1]
    middle = [GuideSettings.centre_prior * max(image_size) * unit[index] for index in (2, 3)]
    columns = [GuideSettings.focal_prior * both, GuideSettings.aspect_prior * apart, *middle]
    # by how many px a unit of each parameter moves the pixel that it moves most
    rays, valid = camera_of(model, intrinsics, image_size).unproject(pixel_grid(image_size).reshape(-1, 2))
    rays, moved = rays[valid & (rays[:, 2] > 0.05)], np.zeros(size)
    if len(rays):
        seen = BoardCorners(rays / rays[:, 2:], np.zeros((len(rays), 2)))
        by_shared = rows(Bundle.start(model, intrinsics, np.zeros((1, 6))), [seen])[1]
        moved = np.linalg.norm(by_shared, axis=1).max(axis=0)[:-SHAPE]
    for index in model.free:
        radial = model.parameter_names[4 + index].startswith("k")
        prior = GuideSettings.radial_prior if radial else GuideSettings.tangential_prior
        half_diagonal = prior * np.hypot(*image_size) / 2
        columns.append(half_diagonal / max(moved[4 + index], 1e-9) * unit[4 + index])
    columns += list(ShapePrior.of(BoardPoints(nominal_m)).std[:, None] * unit[size:])
    return np.stack(columns, axis=1)


def plane_sensitivity(lens: LensInformation, plane: WorkPlane, spec: BoardWithIds) -> np.ndarray | None:
    """(n, 2, p) displacement of points on the plane, m, per unit of each coordinate z, with the camera's pose solved
    again from an exactly seen board in the jig. None where plane or board are hardly in the picture."""
    space = np.pad(plane.points, ((0, 0), (0, 1)))
    inside = lens.in_picture(plane.T_camera_plane @ space)
    board = corner_points(spec)
    moved = deformations(board)
    T_camera_board = plane.board_pose(spec)
    seen = lens.in_picture(T_camera_board @ board)
    if inside.mean() < 0.5 or seen.sum() < GuideSettings.least_jig_corners:
        return None

    def slopes(view: BoardCorners) -> tuple[np.ndarray, np.ndarray]:
        _, by_shared, by_pose, _ = rows(lens.bundle(T_camera_board.vector[None]), [view])
        return by_shared @ lens.scale, by_pose

    jig_shared, jig_pose = slopes(BoardCorners(board[seen], board[seen, :2], moved[seen]))
    # the plane's points turn about the board's origin, as the board does
    on_board = T_camera_board.inverse() @ (plane.T_camera_plane @ space[inside])
    own_shared, own_pose = slopes(BoardCorners(on_board, on_board[:, :2]))
    compensated = np.linalg.lstsq(jig_pose.reshape(-1, 6), jig_shared.reshape(len(jig_shared) * 2, -1), rcond=None)[0]
    in_pixels = own_shared - own_pose @ compensated
    in_plane = own_pose[:, :, 3:] @ plane.T_camera_plane.rotation[:, :2]
    return -np.linalg.solve(in_plane, in_pixels)


def mean_square(sensitivity: np.ndarray, information: np.ndarray) -> np.ndarray:
    """(...) mean variance, m², of points with sensitivity (n, 2, p) under information (..., p, p) and the prior."""
    flat = sensitivity.reshape(-1, sensitivity.shape[-1])
    form = flat.T @ flat / len(sensitivity)
    posterior = information + np.eye(form.shape[0])
    return np.trace(np.linalg.solve(posterior, np.broadcast_to(form, posterior.shape)), axis1=-2, axis2=-1)
