"""One path-traced picture of a plan, as the camera delivers it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from vbaa_calib.geometry import Pose
from vbaa_calib.native import core

from .plan import AntennaShot, BoardShot
from .render.board import Sheet, outline
from .render.object import pressed_in
from .render.picture import Studio, blurred, digitise
from .scene.scene import Joints, SceneSpec, Stretch
from .shots import Strand, free_wires, wires_of
from .traced.bench import antenna_surface, matt, rgb
from .traced.tracer import Exposure, SurfacedTube, Tracer, tracer


class TracedPictures:
    """Takes path-traced pictures of a scene. Raises InputError where mitsuba is not installed."""

    def __init__(self, scene: SceneSpec, place: Studio, sheet: Sheet, rng: np.random.Generator) -> None:
        self._scene, self._place, self._sheet = scene, place, sheet
        self._tracer = tracer(scene, place.rays, rng)

    def shot(self, shot: BoardShot | AntennaShot, after: AntennaShot | None, rng: np.random.Generator) -> np.ndarray:
        """(height, width) or (height, width, 3) BGR, uint8. after : the next frame, for motion blur."""
        scene, T_world_camera = self._scene, self._scene.T_world_camera(shot.joints)
        if isinstance(shot, BoardShot):
            return self._with_board(shot.joints, T_world_camera @ shot.T_camera_board, [], rng)
        things = {}
        if shot.indentation_m is not None:
            things["object"] = self._tracer.touched(pressed_in(scene.object, shot.indentation_m))
        moves = after is not None and scene.traced.shutter > 0
        instants = _while_open(shot, after, scene.traced.shutter) if after is not None and moves else [shot]
        exposures = [self._exposure(one.joints, wires_of(scene, one.arclength_m, one.points_m)) for one in instants]
        return self._taken(self._tracer, exposures, things, rng)

    def over(self, rng: np.random.Generator) -> np.ndarray:
        """The free antenna over the board that lies under it."""
        over = self._scene.over
        assert over is not None
        T_world_board = self._scene.T_world_antenna(over.joints) @ over.T_antenna_board(self._sheet.spec)
        return self._with_board(over.joints, T_world_board, free_wires(self._scene, over.joints), rng)

    def _with_board(
        self, joints: Joints, T_world_board: Pose, wires: list[Strand], rng: np.random.Generator
    ) -> np.ndarray:
        # rig and board are lifted until nothing on the bench reaches through the board
        raised = self._tracer.raised_above(T_world_board @ outline(self._sheet))
        return self._taken(
            raised, [self._exposure(joints, wires)], {"board": raised.board(self._sheet, T_world_board)}, rng
        )

    def _exposure(self, joints: Joints, wires: list[Strand]) -> Exposure:
        scene = self._scene
        drawn = [tube for antenna in wires[:1] for tube in _antenna_tubes(scene, antenna)]
        drawn += [(one.arclength_m, one.points_m, one.radius_m, matt(rgb(one.paint))) for one in wires[1:]]
        return Exposure(scene.T_world_camera(joints), scene.T_world_antenna(joints), drawn)

    def _taken(
        self, from_: Tracer, exposures: list[Exposure], things: dict[str, Any], rng: np.random.Generator
    ) -> np.ndarray:
        spec, light = self._place.spec, self._place.light
        linear = from_.picture(exposures, things, int(rng.integers(2**31)))
        # red, green and blue in grey, as BT.601 weighs them
        grey = np.array([0.299, 0.587, 0.114], np.float32)
        linear, light = (linear[..., ::-1], light[..., None]) if self._scene.traced.color else (linear @ grey, light)
        return digitise(spec, 255.0 * blurred(np.ascontiguousarray(linear), spec.blur_px) * light, rng)


def _antenna_tubes(scene: SceneSpec, antenna: Strand) -> Iterator[SurfacedTube]:
    """The antenna as tubes one behind the other, each with its own surface."""
    spec, first, last = scene.traced, antenna.arclength_m[0], antenna.arclength_m[-1]
    looks: list[Stretch] = [(first, last, spec.material, spec.colour, 0.0), *spec.stretches]
    bounds = np.unique(np.clip([bound for one in looks for bound in one[:2]], first, last))
    for part, middle in zip(antenna.cut(bounds), (bounds[1:] + bounds[:-1]) / 2, strict=True):
        _, _, material, colour, thickness_m = [one for one in looks if one[0] <= middle <= one[1]][-1]
        surface = antenna_surface(material, colour or 3 * (scene.picture.antenna,))
        if surface is not None:
            yield part.arclength_m, part.points_m, part.radius_m + thickness_m, surface


def _while_open(shot: AntennaShot, after: AntennaShot, shutter: float) -> list[AntennaShot]:
    """The antenna at instants while the shutter is open, centred on the shot, on the way to the next frame."""
    ahead, _ = core.simulate.spline(after.arclength_m, after.points_m, shot.arclength_m)
    turn = np.subtract(*(np.array([at.pan_rad, at.tilt_rad]) for at in (after.joints, shot.joints)))
    shares = shutter * ((np.arange(5) + 0.5) / 5 - 0.5)
    return [
        replace(
            shot,
            joints=Joints(*(np.array([shot.joints.pan_rad, shot.joints.tilt_rad]) + share * turn)),
            points_m=shot.points_m + share * (ahead - shot.points_m),
        )
        for share in shares
    ]
