"""The free antenna over a board on plane C, drawn by the simulator, with everything known of it."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from vbaa_calib.calibrate.over_board.over_board import OverSetup, nominal_free_antenna, solve_over_board
from vbaa_calib.calibrate.over_board.over_board import _FreeAntenna as FreeAntenna
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.camera import Camera
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.render.board import print_sheet
from vbaa_calib.simulate.render.picture import studio
from vbaa_calib.simulate.scene.lens import project
from vbaa_calib.simulate.scene.scene import OverSpec, SceneSpec, bundled_scene, camera_pose
from vbaa_calib.simulate.scene.scene_file import load_scene
from vbaa_calib.simulate.shots import free_wires, render_over

CLAMP_ABOUT_Y_STD, BOW_Y_STD, BOW_Z_STD, LOG_STIFFNESS_STD = 0.002, 0.02, 0.3, 0.05
LENGTH_STD_M, HEIGHT_STD_M = 3e-4, 1e-4


@dataclass(frozen=True)
class View:
    """Where the camera is (degrees, m), how the board lies, how the picture is taken, what the antenna is like."""

    inclination: float = 30.0
    azimuth: float = 150.0
    distance: float = 0.366
    look_at: tuple[float, float, float] = (0.118, 0.0, 0.0)
    over: OverSpec = field(default_factory=lambda: OverSpec(0.012, (0.13, 0.005), 1, 0.3))
    blur: float = 0.7
    noise: float = 1.2
    paint: float = 0.92
    diameter: float = 0.0008
    about_y: float = 0.0
    bow: tuple[float, float] = (0.0, 0.0)
    stiffness: float = 1.0


@dataclass(frozen=True, eq=False)
class Shown:
    """A rendered scene: its picture, the camera, and what the user would say of the antenna."""

    scene: SceneSpec
    over: OverSpec
    picture: np.ndarray
    camera: Camera
    antenna: FreeAntenna

    @property
    def truth(self) -> Pose:
        """T_antenna_camera."""
        return self.scene.T_antenna_camera

    @property
    def T_camera_board(self) -> Pose:
        """Pose of the printed face."""
        return self.truth.inverse() @ self.over.T_antenna_board(self.scene.board)

    def centreline_px(self) -> np.ndarray:
        """(4000, 2) the antenna's true centreline from clamp to tip."""
        wire = free_wires(self.scene, self.over.joints)[0]
        s = np.linspace(0.0, wire.arclength_m[-1], 4000)
        points = np.stack([np.interp(s, wire.arclength_m, column) for column in wire.points_m.T], axis=1)
        return project(self.scene.lens, self.truth.inverse() @ points)

    def solved(self, **changes: Any) -> PoseEstimate:
        """The camera by `solve_over_board` of this picture, with a guess that is a few degrees and millimetres off."""
        guess = self.truth.retract(np.array([0.03, -0.02, 0.05, 0.004, -0.004, 0.003]))
        options = {"images": {"over.png": self.picture}, "guess": guess} | changes
        pictures = {name: options.pop(name) for name in ("images", "guess")}
        known = {"antenna": self.antenna, "height_m": self.over.height_m, "height_std_m": HEIGHT_STD_M}
        setup = OverSetup(**{"spec": self.scene.board, "camera": self.camera} | known | options)
        return solve_over_board(setup=setup, **pictures)[0]


@functools.cache
def shown(view: View, seed: int = 0, wires: int = 2) -> Shown:
    """Render a view; `wires` 2 with antenna and holder, 0 with neither."""
    base = load_scene(bundled_scene("demo"))
    inclination, azimuth = np.radians([view.inclination, view.azimuth])
    true = replace(
        base.true,
        stiffness_factor=view.stiffness,
        clamp_angle_rad=np.array([view.about_y, 0.0]),
        clamp_offset_m=np.zeros(3),
        natural_curvature_per_m=np.array(view.bow),
    )
    scene = replace(
        base,
        T_antenna_camera=camera_pose(inclination, azimuth, 0.03, view.distance, np.array(view.look_at)),
        true=true,
        antenna=replace(base.antenna, diameter_m=view.diameter),
        picture=replace(base.picture, antenna=view.paint, blur_px=view.blur, read_noise=view.noise),
    )
    place = studio(scene.lens, scene.picture, np.random.default_rng(seed))
    drawn = free_wires(scene, view.over.joints)[:wires]
    if not wires:
        view = replace(view, over=replace(view.over, shadow=0.0))
    picture = render_over(scene, place, print_sheet(scene.board), view.over, drawn, np.random.default_rng(seed))
    lens = scene.lens
    nominal = nominal_free_antenna(scene.antenna, scene.gravity_world_m_s2)
    std = [0.0, 0.0, CLAMP_ABOUT_Y_STD, 0.0, BOW_Y_STD, BOW_Z_STD, LOG_STIFFNESS_STD, 0.0, 0.0]
    antenna = replace(nominal, covariance=np.diag(np.square(std)))
    return Shown(scene, view.over, picture, Camera(lens.model, lens.image_size, lens.matrix, lens.distortion), antenna)


def drawn_view(seed: int, paint: float) -> View:
    """A view at random: steep to 50° oblique from any side, the board any way round, 1.6 to 4.5 px of antenna."""
    rng = np.random.default_rng(seed)
    height, centre, turn = (
        rng.uniform(0.012, 0.02),
        rng.uniform([0.11, -0.02], [0.15, 0.02]),
        rng.uniform(-np.pi, np.pi),
    )
    return View(
        inclination=rng.uniform(3.0, 50.0),
        azimuth=rng.uniform(0.0, 360.0),
        distance=rng.uniform(0.34, 0.4),
        look_at=(rng.uniform(0.11, 0.125), rng.uniform(-0.01, 0.01), 0.0),
        over=OverSpec(height, (float(centre[0]), float(centre[1])), 1, turn),
        blur=rng.uniform(0.5, 1.0),
        noise=rng.uniform(1.0, 3.0),
        paint=paint,
        diameter=rng.uniform(0.00065, 0.0016),
        about_y=CLAMP_ABOUT_Y_STD * rng.normal(),
        bow=(BOW_Y_STD * rng.normal(), BOW_Z_STD * rng.normal()),
        stiffness=float(np.exp(LOG_STIFFNESS_STD * rng.normal())),
    )
