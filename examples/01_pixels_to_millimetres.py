"""From pixels to millimetres on plane C, with what a tenth of a pixel is worth there."""

import numpy as np
import torch
from drawing import BLUE, ORANGE, canvas, figures_folder, save

from vbaa import Camera
from vbaa_calib.camera import CameraOnPlane
from vbaa_calib.geometry import Pose

camera = Camera(
    model="opencv",
    image_size=(1280, 720),
    matrix=np.array([[900.0, 0.0, 640.0], [0.0, 900.0, 360.0], [0.0, 0.0, 1.0]]),
    distortion=np.array([-0.25, 0.08, 0.0005, -0.0003]),
)
# A camera 0.4 m above the middle of the antenna, looking straight down at plane C.
T_antenna_camera = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.12, 0.0, 0.4]))
layer = CameraOnPlane(camera, T_antenna_camera)

pixels = torch.tensor([[640.0, 360.0], [400.0, 300.0], [900.0, 420.0]], dtype=torch.float64, requires_grad=True)
xy, valid = layer.project(pixels)
std = layer.covariance(pixels, sigma_px=0.1).diagonal(dim1=-2, dim2=-1).sqrt()
for point, spread, good in zip(xy.tolist(), std.tolist(), valid.tolist(), strict=True):
    print(f"x = {1e3 * point[0]:7.2f} mm, y = {1e3 * point[1]:7.2f} mm, ± {1e3 * spread[0]:.3f} mm, valid: {good}")

xy.sum().backward()
print("moved by one pixel to the right, the second point moves by", f"{1e3 * pixels.grad[1, 0]:.3f} mm in x + y")

if folder := figures_folder():
    v, u = np.mgrid[0:720:24, 0:1280:24] + 12.0
    grid = np.stack([u, v], axis=-1)
    on_plane_mm = 1e3 * layer.project(grid)[0]
    worst_mm = 1e3 * np.sqrt(np.linalg.eigvalsh(layer.covariance(grid, sigma_px=0.1))[..., -1])
    figure, (left, right) = canvas(2, 3.0)
    left.plot(*on_plane_mm[::2].transpose(2, 1, 0), ".", color=BLUE, markersize=2)
    left.plot([0, 240], [0, 0], color=ORANGE, linewidth=2.5, label="antenna, straight")
    left.set(xlabel="x on plane C, mm", ylabel="y, mm", title="every 24th pixel on plane C", aspect="equal")
    left.legend(loc="lower right")
    shades = right.pcolormesh(u, v, worst_mm, cmap="viridis", shading="nearest")
    figure.colorbar(shades, ax=right, label="mm", shrink=0.62)
    right.set(xlabel="u, px", ylabel="v, px", title="what 0.1 px is worth on plane C", aspect="equal")
    right.invert_yaxis()
    save(figure, folder, __file__)
