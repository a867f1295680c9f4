"""Quality of a picture of the board: blur, saturation and contrast across the edges of its squares."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from targets.board import AprilGrid, BoardSpec, Chessboard

from .settings import DetectionSettings


@dataclass(frozen=True)
class ViewQuality:
    """Quality of one view of the board.

    Attributes
    ----------
    collinear : whether the corners, all but one on a line, determine no homography.
    blur_px : standard deviation of the point spread, including the pixel's area, along the board's x and y; NaN without
        neighbouring corners. Right to 10 % up to half of `gap_px`; too small beyond, and where the camera sharpens.
    direction_rad : direction of the larger blur in the picture, from u towards v, in (−π/2, π/2]; NaN as above.
    gap_px : distance from the squares' edges to the markers; without markers, to the middle of the square.
    contrast : white less black, grey levels.
    saturated : share of the white pixels (or of the black ones, if that is more) beyond the camera's range.
    edge_level : grey level at the squares' edges, from black (0) to white (1): 0.5 in a linear picture, up to about
        0.75 after a display's gamma, more where clipped or blooming white spreads over the edges.
    """

    collinear: bool
    blur_px: tuple[float, float]
    direction_rad: float
    gap_px: float
    contrast: float
    saturated: float
    edge_level: float

    @property
    def mean_blur_px(self) -> float:
        """Root mean square of the known blurs; NaN if both are unknown."""
        known = [blur for blur in self.blur_px if np.isfinite(blur)]
        return float(np.sqrt(np.mean(np.square(known)))) if known else float("nan")

    @property
    def motion(self) -> float:
        """Ratio of the larger blur to the smaller, 1 for a camera at rest; NaN if one is unknown."""
        return float(max(self.blur_px) / min(self.blur_px)) if np.isfinite(self.blur_px).all() else float("nan")

    @property
    def blur_in_words(self) -> str:
        """The blur's direction, as far as it is determined."""
        if self.motion > DetectionSettings.moved:
            return f"{self.motion:.1f} times more along {np.degrees(self.direction_rad):.0f}° than across: motion"
        return "much alike along both sides of the squares"


def measure_quality(
    image: np.ndarray, ids: np.ndarray, corners_px: np.ndarray, spec: BoardSpec | AprilGrid | Chessboard
) -> ViewQuality:
    """The quality of a view: picture (H, W) uint8, corner ids (N,) and their pixels (N, 2)."""
    columns = spec.corner_columns
    cells = np.stack([ids % columns, ids // columns], axis=1)
    edges = [_edges(ids, cells, step, columns, spec.corner_count) for step in ((0, 1), (1, 0))]
    # without markers beside the edges to the middle of the square
    room = (1.0 - spec.marker_m / spec.square_m if isinstance(spec, BoardSpec) else 1.0) / 2.0
    gap_px = _gap_px(corners_px, np.concatenate(edges), room)
    across = [_across(image, corners_px[pair], gap_px, gap_px / room) for pair in edges]
    blur = (across[0].blur_px[0], across[1].blur_px[0])
    wider = across[int(np.nan_to_num(blur[1]) > np.nan_to_num(blur[0]))]
    seen = [one for one in across if np.isfinite(one.contrast)] or across[:1]
    return ViewQuality(
        collinear=not fixes_homography(cells.astype(float)),
        blur_px=blur,
        direction_rad=wider.direction_rad,
        gap_px=gap_px,
        contrast=float(np.mean([one.contrast for one in seen])),
        saturated=max(one.saturated for one in seen),
        edge_level=float(np.mean([one.edge_level for one in seen])),
    )


def _edges(ids: np.ndarray, cells: np.ndarray, step: tuple[int, int], columns: int, count: int) -> np.ndarray:
    """(E, 2) indices of corners one step (column, row) apart; at most `most_edges`, evenly spaced."""
    index = np.full(count + columns + 1, -1)
    index[ids] = np.arange(len(ids))
    second = index[ids + step[0] + step[1] * columns]
    found = np.flatnonzero((second >= 0) & (cells[:, 0] + step[0] < columns))
    chosen = found[np.linspace(0, len(found) - 1, min(len(found), DetectionSettings.most_edges)).astype(int)]
    return np.stack([chosen, second[chosen]], axis=1)


def _gap_px(corners_px: np.ndarray, edges: np.ndarray, room: float) -> float:
    if not len(edges):
        return float("nan")
    lengths = np.linalg.norm(np.diff(corners_px[edges], axis=1)[:, 0], axis=1)
    return float(np.percentile(lengths, 20.0)) * room


def _across(image: np.ndarray, ends: np.ndarray, gap_px: float, square_px: float) -> ViewQuality:
    """Quality across edges between corners (E, 2, 2) px of one direction, from profiles between the middle of the
    black square and that of the white one.

    The blur is measured in the black half, which contains nothing but the edge: there a Gaussian edge of height 2a has
    the squared slopes' integral a² / (√π σ).
    """
    if not len(ends):
        nan = float("nan")
        return ViewQuality(False, (nan, nan), nan, gap_px, nan, 0.0, nan)
    black_steps = int(
        np.clip(
            DetectionSettings.into_black * square_px / DetectionSettings.edge_step_px, 4, DetectionSettings.most_steps
        )
    )
    along = ends[:, 1] - ends[:, 0]
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    points = ends[:, :1] + np.linspace(0.2, 0.8, 7)[:, None] * along[:, None]
    sides = _sampled(image, points, normal, np.array([-0.5, 0.5]) * gap_px)
    towards_white = np.where(sides[:, :, 1].sum(axis=1) > sides[:, :, 0].sum(axis=1), 1.0, -1.0)
    offsets = np.append(DetectionSettings.edge_step_px * np.arange(-black_steps, 1), 0.5 * gap_px)
    samples = _sampled(image, points, towards_white[:, None] * normal, offsets)
    profiles = samples.mean(axis=1)
    black = profiles[:, :3].mean(axis=1)
    rise = profiles[:, -2] - black
    energy = (np.diff(profiles[:, :-1], axis=1) ** 2).sum(axis=1) / DetectionSettings.edge_step_px
    spread = float(np.median(rise**2 / (np.sqrt(np.pi) * np.maximum(energy, 1e-9))))
    contrast = float(np.median(profiles[:, -1] - black))
    doubled = 2.0 * np.arctan2(normal[:, 1], normal[:, 0])
    # what bilinear sampling and the difference over one step add to the spread of an edge; a pixel's area
    added_px2, pixel_px2 = 1.0 / 6.0 + DetectionSettings.edge_step_px**2 / 12.0, 1.0 / 12.0
    blur_px = float(np.sqrt(max(spread**2 - added_px2, pixel_px2)))
    return ViewQuality(
        collinear=False,
        blur_px=(blur_px, blur_px),
        direction_rad=0.5 * float(np.arctan2(np.sin(doubled).mean(), np.cos(doubled).mean())),
        gap_px=gap_px,
        contrast=contrast,
        saturated=float(
            max(
                (samples[..., 0] < DetectionSettings.blackest).mean(),
                (samples[..., -1] > DetectionSettings.whitest).mean(),
            )
        ),
        edge_level=float(np.median(rise)) / max(contrast, 1.0),
    )


def _sampled(image: np.ndarray, points: np.ndarray, normal: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """(E, P, S) grey levels at offsets (S,) px along normals (E, 2) from points (E, P, 2)."""
    where = points[:, :, None] + offsets[:, None] * normal[:, None, None]
    flat = where.astype(np.float32).reshape(len(points), -1, 2)
    grey = cv2.remap(image, flat, np.empty(0), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return grey.reshape(where.shape[:-1]).astype(float)


def fixes_homography(plane_points: np.ndarray) -> bool:
    """Whether points (N, 2) of a plane determine its homography to a picture: no line contains all but one of them."""
    if len(plane_points) < 4:
        return False
    centred = plane_points - plane_points.mean(axis=0)
    centred = centred / max(float(np.abs(centred).max()), 1e-12)
    homogeneous = np.column_stack([centred, np.ones(len(centred))])
    zeros = np.zeros_like(homogeneous)
    design = np.vstack(
        [
            np.hstack([homogeneous, zeros, -centred[:, :1] * homogeneous]),
            np.hstack([zeros, homogeneous, -centred[:, 1:] * homogeneous]),
        ]
    )
    values = np.linalg.svd(design, compute_uv=False)
    return bool(values[7] > 1e-3 * values[0])
