"""A second renderer: light on a fine grid, the lens's blur on it, then what sensor and software make of it.

Each thing in a picture is a layer that says how much of a fine pixel it covers and how bright it is there; edges are
those of areas, not of points. Only tiles in which something lies are made on the fine grid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import cv2
import numpy as np
import torch
from scipy.interpolate import RectBivariateSpline
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from torch.nn.functional import grid_sample

from .mechanics import Bent
from .optics import Optics

VARIANTS = ("well sampled", "blurred after sampling", "Bayer", "sharpened", "JPEG", "fill 0.6", "row noise")
INK, PAPER, GREY_LEVELS = 0.06, 0.85, 255.0
_TILE, _REACH = 128, 4.0
"""Pixels of a tile's side; standard deviations of the blur that count."""


@dataclass(frozen=True)
class Sensor:
    """How light becomes numbers. `variant` : of `VARIANTS`. `quality` : of JPEG.

    blur_px : of the lens, standard deviation. read_noise : grey levels. electrons : per grey level.
    """

    variant: str
    blur_px: float
    read_noise: float
    electrons: float
    quality: int
    fine: int

    @property
    def suffix(self) -> str:
        """Of the pictures' files."""
        return ".jpg" if self.variant == "JPEG" else ".png"


class Layer(Protocol):
    """A thing in a picture."""

    @property
    def box(self) -> np.ndarray:
        """(4,) first and last column and row that it can touch."""

    def cover(self, rows: np.ndarray, columns: np.ndarray, fine_px: float) -> tuple[np.ndarray, np.ndarray]:
        """(R, C) part of each fine pixel that it covers, and its brightness there, 0 to 1."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """A printed ChArUco board with a white margin: texture (rows, columns), its texel and its margin in m."""

    optics: Optics
    texture: np.ndarray
    texel_m: float
    margin_m: float
    turn: Rotation
    shift_m: np.ndarray

    @cached_property
    def box(self) -> np.ndarray:
        """From the outline, straight lines between close points."""
        height, width = (side * self.texel_m for side in self.texture.shape)
        round_ = np.linspace(0.0, 1.0, 20)
        sides = [(round_, 0 * round_), (round_, 1 + 0 * round_), (0 * round_, round_), (1 + 0 * round_, round_)]
        flat = np.concatenate([np.stack(side, axis=1) for side in sides]) * [width, height] - self.margin_m
        placed = self.turn.apply(np.pad(flat, ((0, 0), (0, 1)))) + self.shift_m
        pixels = self.optics.pixels(placed)
        return np.array([*pixels.min(axis=0), *pixels.max(axis=0)])[[0, 2, 1, 3]]

    @cached_property
    def _texels(self) -> tuple[RectBivariateSpline, RectBivariateSpline]:
        """Columns and rows of the texture over rows and columns of the picture, by rays that meet the sheet."""
        rows, columns, rays = self.optics.grid
        axes = self.turn.as_matrix()
        back = np.linalg.inv(np.stack([axes[:, 0], axes[:, 1], self.shift_m], axis=1))
        met = rays @ back[:, :2].T + back[:, 2]
        texels = (met[..., :2] / met[..., 2:].clip(1e-9) + self.margin_m) / self.texel_m - 0.5
        first, second = (RectBivariateSpline(rows, columns, texels[..., axis]) for axis in (0, 1))
        return first, second

    def cover(self, rows: np.ndarray, columns: np.ndarray, fine_px: float) -> tuple[np.ndarray, np.ndarray]:
        """By each fine pixel's ray, bilinear between texels of about a fine pixel."""
        size = np.array(self.texture.shape)[::-1]
        # within a pixel the way over the texture is straight
        ends = [np.append(side[:: round(1.0 / fine_px)], side[-1] + fine_px) for side in (rows, columns)]
        coarse = np.stack([spline(*ends) for spline in self._texels], axis=-1)
        texels = torch.from_numpy((2.0 * coarse / (size - 1.0) - 1.0).clip(-3.0, 3.0).astype(np.float32))
        wanted = [torch.from_numpy(((side - side[0]) % 1.0).astype(np.float32)) for side in (rows, columns)]
        at = [torch.from_numpy((side - side[0]).astype(np.int64)) for side in (rows, columns)]
        down = torch.lerp(texels[at[0]], texels[at[0] + 1], wanted[0][:, None, None])
        grid = torch.lerp(down[:, at[1]], down[:, at[1] + 1], wanted[1][None, :, None])
        bright = grid_sample(torch.from_numpy(self.texture)[None, None], grid[None], align_corners=True)[0, 0]
        return (grid.abs() < 1.0).all(dim=-1).float().numpy(), bright.numpy()


def print_board(
    squares: tuple[int, int], dictionary: str, square_m: float, module_texels: int
) -> tuple[np.ndarray, float, float]:
    """Texture, texel and margin of a board whose markers are `modules`/(modules + 2) of its squares."""
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    modules = int(known.markerSize) + 2
    side = modules + 2
    cells = np.ones((squares[1] * side, squares[0] * side), np.float32)
    number = 0
    for row in range(squares[1]):
        for column in range(squares[0]):
            at = np.s_[row * side : (row + 1) * side, column * side : (column + 1) * side]
            if (row + column) % 2 == 0:
                cells[at] = 0.0
            else:
                cells[at][1:-1, 1:-1] = known.generateImageMarker(number, modules) > 127
                number += 1
    cells = np.pad(cells, side // 2, constant_values=1.0)
    texture = np.kron(cells, np.ones((module_texels, module_texels), np.float32)) * (PAPER - INK) + INK
    return texture, square_m / (side * module_texels), side // 2 * square_m / side


@dataclass(frozen=True, eq=False)
class Tube:
    """A round wire, pin or thread: the picture of its axis (N, 2), of both silhouettes (N,), along the normals, and how
    long it is there (N,), px; paint at the axis and at the silhouette."""

    axis_px: np.ndarray
    edges_px: np.ndarray
    paint: tuple[float, float]

    @staticmethod
    def of(optics: Optics, points_camera_m: np.ndarray, radius_m: float, paint: tuple[float, float]) -> Tube:
        """Around an axis of many points (N, 3) in the camera frame: the silhouettes are where rays touch it."""
        axis = optics.pixels(points_camera_m)
        way = np.concatenate([[0.0], np.linalg.norm(np.diff(axis, axis=0), axis=1).cumsum()])
        even = np.linspace(0.0, way[-1], max(int(4 * way[-1]), 8))
        points = np.stack([np.interp(even, way, each) for each in points_camera_m.T], axis=1)
        along = np.gradient(points, axis=0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        towards = -points + (points * along).sum(axis=1, keepdims=True) * along
        away = np.linalg.norm(towards, axis=1, keepdims=True)
        towards, part = towards / away, (radius_m / away).clip(max=0.99)
        side = np.cross(along, towards) * np.sqrt(1.0 - part**2)
        axis = optics.pixels(points)
        normal = _normals(axis)
        touched = [optics.pixels(points + radius_m * (part * towards + sign * side)) for sign in (-1.0, 1.0)]
        edges = np.sort([((each - axis) * normal).sum(axis=1) for each in touched], axis=0)
        return Tube(axis, edges, paint)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.axis_px)

    @cached_property
    def _across(self) -> np.ndarray:
        return _normals(self.axis_px)

    @property
    def _reach(self) -> float:
        return float(np.abs(self.edges_px).max()) + 1.5

    @cached_property
    def box(self) -> np.ndarray:
        """With its width."""
        low, high = self.axis_px.min(axis=0) - self._reach, self.axis_px.max(axis=0) + self._reach
        return np.array([low[0], high[0], low[1], high[1]])

    def cover(self, rows: np.ndarray, columns: np.ndarray, fine_px: float) -> tuple[np.ndarray, np.ndarray]:
        """By the distance of each fine pixel from the axis, along its normal; square ends."""
        fine = round(1.0 / fine_px)
        covered = np.zeros((len(rows), len(columns)), np.float32)
        bright = np.zeros_like(covered)
        place = np.rint(self.axis_px - np.rint([columns[0], rows[0]])).astype(int)
        place = place[((place > -_TILE) & (place < 2 * _TILE)).all(axis=1)]
        wide = 2 * int(np.ceil(self._reach)) + 1
        padded = np.zeros((len(rows) // fine + 2 * _TILE, len(columns) // fine + 2 * _TILE), np.uint8)
        padded[tuple((place.T[::-1] + _TILE).clip(0, np.array(padded.shape)[:, None] - 1))] = 1
        spread = cv2.dilate(padded, np.ones((wide, wide), np.uint8))[_TILE:-_TILE, _TILE:-_TILE]
        row, column = np.nonzero(np.kron(spread, np.ones((fine, fine), np.uint8)))
        if not len(row):
            return covered, bright
        at = np.stack([columns[column], rows[row]], axis=1)
        nearest = self._tree.query(at)[1]
        normal = self._across[nearest]
        off = at - self.axis_px[nearest]
        across, beyond = (
            (off * normal).sum(axis=1),
            np.abs(off @ [1.0, 0.0] * normal[:, 1] - off @ [0.0, 1.0] * normal[:, 0]),
        )
        low, high = self.edges_px[:, nearest]
        part = np.clip((high - across) / fine_px + 0.5, 0, 1) - np.clip((low - across) / fine_px + 0.5, 0, 1)
        last = (nearest == 0) | (nearest == len(self.axis_px) - 1)
        part *= np.where(last, np.clip(0.5 - (beyond - fine_px / 2) / fine_px, 0, 1), 1.0)
        place = np.clip((2 * across - low - high) / (high - low).clip(1e-9), -1, 1)
        covered[row, column] = part
        bright[row, column] = self.paint[1] + (self.paint[0] - self.paint[1]) * np.sqrt(1 - place**2)
        return covered, bright


def _normals(line: np.ndarray) -> np.ndarray:
    along = np.gradient(line, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True).clip(1e-12)
    return np.stack([-along[:, 1], along[:, 0]], axis=1)


def wire_axis(bent: Bent, first_m: float, last_m: float) -> np.ndarray:
    """(400, 3) points along a wire between two arc lengths."""
    return bent.at(np.linspace(first_m, last_m, 400))


def photograph(
    optics: Optics, sensor: Sensor, bench: np.ndarray, layers: Sequence[Layer], rng: np.random.Generator
) -> np.ndarray:
    """A picture, uint8 (H, W) or (H, W, 3): layers, the farthest first, before a bench (H, W) that is smooth."""
    width, height = optics.size
    light = bench.astype(np.float32).copy()
    margin = int(np.ceil(_REACH * sensor.blur_px)) + 2
    for top in range(0, height, _TILE):
        for left in range(0, width, _TILE):
            right, bottom = min(left + _TILE, width), min(top + _TILE, height)
            box = np.array([left - margin, right + margin, top - margin, bottom + margin])
            touched = [one for one in layers if _meets(one.box, box)]
            if touched:
                light[top:bottom, left:right] = _tile(sensor, bench, touched, box, margin)
    return _developed(sensor, light, rng)


def _meets(one: np.ndarray, other: np.ndarray) -> bool:
    return bool(one[0] < other[1] and one[1] > other[0] and one[2] < other[3] and one[3] > other[2])


def _tile(sensor: Sensor, bench: np.ndarray, layers: Sequence[Layer], box: np.ndarray, margin: int) -> np.ndarray:
    """A tile without its margin, as the pixels gather its light."""
    fine = sensor.fine
    columns, rows = (
        np.arange(fine * low, fine * high) / fine + (1.0 / fine - 1.0) / 2 for low, high in (box[:2], box[2:])
    )
    at = np.stack(np.meshgrid(columns.astype(np.float32), rows.astype(np.float32)))
    scene = cv2.remap(bench.astype(np.float32), at[0], at[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    for layer in layers:
        covered, bright = layer.cover(rows, columns, 1.0 / fine)
        scene = scene + covered * (bright - scene)
    if sensor.variant != "blurred after sampling":
        scene = cv2.GaussianBlur(scene, (0, 0), sensor.blur_px * fine)
    side = 0.6**0.5 * fine if sensor.variant == "fill 0.6" else fine
    part = np.clip(side / 2 - np.abs(np.arange(fine) - (fine - 1) / 2) + 0.5, 0, 1)
    part /= part.sum()
    gathered = np.einsum("ikjl,k,l->ij", scene.reshape(len(rows) // fine, fine, -1, fine), part, part, optimize=True)
    if sensor.variant == "blurred after sampling":
        gathered = cv2.GaussianBlur(gathered, (0, 0), sensor.blur_px)
    return np.asarray(gathered[margin:-margin, margin:-margin])


_WHITE = np.array([0.62, 1.0, 0.75])
"""How sensitive blue, green and red pixels are: evened out before demosaicing, which multiplies the noise."""


def _developed(sensor: Sensor, light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    grey = np.float32(GREY_LEVELS) * light
    gain = np.ones_like(grey)
    if sensor.variant == "Bayer":
        gain[0::2, 0::2], gain[1::2, 1::2] = _WHITE[2], _WHITE[0]
    noise = np.sqrt(np.maximum(grey * gain, 0.0) / sensor.electrons + sensor.read_noise**2)
    seen = (grey * gain + noise * rng.standard_normal(grey.shape, np.float32)) / gain
    if sensor.variant == "row noise":
        seen += rng.normal(0.0, 1.5, (len(seen), 1))
    if sensor.variant == "sharpened":
        seen += 0.8 * (seen - cv2.GaussianBlur(seen, (0, 0), 1.0))
    picture = np.clip(np.rint(seen), 0, 255).astype(np.uint8)
    return cv2.cvtColor(picture, cv2.COLOR_BAYER_RGGB2BGR) if sensor.variant == "Bayer" else picture


def encoded(sensor: Sensor, picture: np.ndarray) -> bytes:
    """The picture's file."""
    plain = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
    how = [cv2.IMWRITE_JPEG_QUALITY, sensor.quality] if sensor.suffix == ".jpg" else plain
    return cv2.imencode(sensor.suffix, picture, how)[1].tobytes()


def bench_of(size: tuple[int, int], level: float, contrast: float, rng: np.random.Generator) -> np.ndarray:
    """(H, W) a smooth bench with light from one side, 0 to 1."""
    width, height = size
    field = np.zeros((height, width))
    for cells in (3, 7, 16):
        coarse = rng.standard_normal((cells + 3, cells + 3)).astype(np.float32)
        field += np.asarray(cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC), float) / cells**0.5
    slope = rng.normal(0.0, 0.1, 2)
    x, y = np.linspace(-0.5, 0.5, width), np.linspace(-0.5, 0.5, height)
    return np.clip(level * (1.0 + contrast * field + slope[0] * x + slope[1] * y[:, None]), 0.02, 0.98).astype(
        np.float32
    )
