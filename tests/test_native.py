"""The compiled core: builds for processors, and what it refuses."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.solver.numbers import FitNumbers
from vbaa_calib.detect.whisker.settings import RibbonSettings, SearchSettings
from vbaa_calib.native import core, levels

ROOT = Path(__file__).parents[1]
NAMES = """
from vbaa_calib.native import core
print(core.__name__, *(f"{room}.{name}" for room in dir(core) for name in dir(getattr(core, room))))
"""


def _functions() -> Iterator[tuple[str, Callable[..., object]]]:
    rooms = [room for room in vars(core).values() if isinstance(room, ModuleType)]
    for room in rooms:
        for name, function in vars(room).items():
            if type(function).__name__ == "nb_func":
                yield f"{room.__name__.rpartition('.')[2]}.{name}", function


FUNCTIONS = dict(_functions())
TRIES = int(os.environ.get("VBAA_WRONG_CALLS", "60"))


def _in_child(code: str, **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code], env=os.environ | variables, cwd=ROOT, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("level", levels)
def test_every_build_has_the_same_functions(level: str) -> None:
    name, *functions = _in_child(NAMES, VBAA_PROCESSOR=level).stdout.split()
    assert name == f"vbaa_calib.native.{level}.core"
    assert {each for each in functions if each in FUNCTIONS} == set(FUNCTIONS)


def test_an_unknown_build_is_refused_in_one_line() -> None:
    done = _in_child("import vbaa_calib.native", VBAA_PROCESSOR="v9")
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "v9" in done.stderr


@pytest.mark.parametrize("name", FUNCTIONS)
def test_what_is_no_array_is_refused(name: str) -> None:
    """Also arrays of another kind, without entries or with holes: an error of Python's, never a crash."""
    holes = np.zeros((6, 6))[::2, ::2]
    for wrong in ("text", None, holes, np.zeros(3, np.complex64), np.empty((0, 0, 0, 0))):
        for count in range(1, 14):
            with pytest.raises((TypeError, ValueError, AttributeError)):
                FUNCTIONS[name](*[wrong] * count)


RNG = np.random.default_rng(7)
LENS = core.lens.Lens(False, np.array([800.0, 800.0, 320.0, 240.0, -0.1, 0.02, 1e-3, 1e-3]))


def _a(*shape: int) -> np.ndarray:
    return RNG.uniform(0.1, 1.0, shape)


def _whole(*values: int) -> np.ndarray:
    return np.array(values, np.int64)


def _fields(**shapes: object) -> SimpleNamespace:
    """An object with arrays of these shapes; what is no tuple stays."""
    return SimpleNamespace(**{name: _a(*each) if isinstance(each, tuple) else each for name, each in shapes.items()})


def _calls() -> dict[str, tuple[object, ...]]:
    """Right arguments of every function."""
    curve = (np.sort(_a(2, 4)), _a(2, 4, 2), _a(2, 4, 2))
    on_plane = (np.eye(3, 4), np.array([0.0, 0.0, 1.0, 2.0]), np.eye(3))
    corners = _fields(points_m=(9, 3), deformation=(9, 3, 5), pixels=(9, 2), weights=(9,), bounds=_whole(0, 4, 9))
    numbers = dict.fromkeys(("tail", "noise_px", "least_slope", "stiffness_px", "width", "height"), 3.0)
    priors, state = _fields(mean=(5,), std=(5,), **numbers), _fields(fisheye=False, lens=(8,), shape=(5,), poses=(2, 6))
    rules = _fields(iterations=4, tolerance=1e-6, damping=1e-3, growth=10.0, may_rise_share=0.1)
    column = np.arange(13)
    taper = np.array([[0.0, 0.4, 1.0, 0.7, 1.0, 0.7, 4.0], [0.4, 1.0, 0.5, 0.3, 0.2, 0.1, 1.0]])
    presses = (_a(3, 9), 0.2, taper, _a(3, 3), 0.1 * _a(3), _a(3, 2), _a(3))
    lanes = (_a(9, 8), 0.2, taper, _a(3), 0.1 * _a(8), _a(2, 8), _a(8))
    kept = dict.fromkeys(("length_m", "bend", "twist", "mass_per_length_kg_m", "curvature_y", "curvature_z"), 0.2)
    rod, uniform = (_fields(clamp=np.eye(3), pieces=each, **kept) for each in (taper, taper[:0]))
    object_ = _fields(kind=1, center_m=(3,), axis=(3,), wedge=(3,), radius_m=0.5, bumps=(2, 5))
    body = _fields(object=object_, sides=(2, 4), across=(3, 3), reach_m=1.0, steepest=1.0)
    image, path = RNG.integers(0, 255, (60, 80), np.uint8), np.linspace([5.0, 30.0], [70.0, 33.0], 9)
    paths, looks = np.stack([path, path + 9.0]), _a(5, 4)
    colour = np.repeat(image[..., None], 3, axis=2)
    found = core.search.crossings(image, path, 9, 1.0)
    free = _fields(clamp_m=(3,), axes=np.eye(3), segments_m=np.array([[0.05, 0.0, 0.0]] * 6))
    rig_numbers = dict.fromkeys(("length_m", "radius_m", "force_unit_N", "unit_load", "stiffness_Nm2"), 1.0)
    flags, known = (
        dict.fromkeys(("with_tip", "with_wrench", "with_lens"), True),
        {"axes": (40, 3), "by_pose_step": (8,)},
    )
    small = dict.fromkeys(("friction_rad", "tip_offset_m"), 0.1)
    pose = {"pose_lanes": (3, 4, 8), "rotation": np.eye(3), "translation_m": (3,), "to_camera": (2,), "eye_m": (3,)}
    cameras = tuple(_fields(**pose, line=(3,), focal=1.0, lens=LENS) for _ in range(2))
    more = {"antenna_parameters": (9,), "antenna_steps": (9,)}
    sensors = {"std": (7,), "by_wrench": (7, 7), "by_sensor": (2, 7, 7)}
    more["taper"] = taper
    fields = _fields(**rig_numbers, **small, **flags, **known, **more, **sensors, readings=3)
    rig, exact = (core.solver.Rig(each, cameras) for each in (fields, _fields(**vars(fields) | {"axes": (40, 0)})))
    frames = _fields(
        usable=(3, 9), points=(3, 9, 2), covariance=(3, 9, 3), reading=(3, 3), tip=(3, 2), tip_covariance=(3, 3)
    )
    frames.available, frames.gravity_m_s2 = np.ones((3, 3)), _a(3, 3)
    frames.camera, frames.tip_camera = np.tile(_whole(*[0] * 4, *[1] * 5), (3, 1)), _whole(0, 1, 0)
    planes = RNG.uniform(0.0, 255.0, (3, 36, 40)).astype(np.float32)
    ways = core.search.DIRECTIONS_DOWN
    ribbons = [RNG.normal(0.0, 2.0, each).astype(np.float32) for each in ((7, ways, 40), (8, ways, 36))]
    nodes, pieces = core.solver.NODES, core.solver.PIECES
    linear = {"tangents": (3, nodes), "point_force": (6,), "columns": (6, 13), "residual": (3,)}
    linear |= {"readings": (3, 13), "information": (13, 13), "side": (13,), "prior": (13,), "excess": ()}
    linearised = _fields(**{name: (3, *shape) for name, shape in linear.items()})
    antennas = _fields(information=(3, 9, 9), side=(3, 9), gain=(3,))
    return {
        "lens.interpolate": (*curve, _a(3)),
        "lens.feet": (*curve, _a(3, 2)),
        "lens.whitened": (*curve, _a(3, 2), _a(3, 2, 2)),
        "Lens.__init__": (False, _a(8)),
        "Lens.project": (_a(3, 3), True),
        "Lens.chart": (_a(3, 2),),
        "Lens.unproject": (_a(3, 2),),
        "Lens.rays_with_slopes": (_a(3, 2),),
        "Lens.normalized": (_a(3, 2), True),
        "Lens.normalized_by_lens": (_a(3, 2),),
        "Lens.on_plane": (_a(3, 2), *on_plane),
        "Lens.plane_slopes": (_a(3, 2), *on_plane, True),
        "bundle.descend": (state, corners, column, priors, rules, True),
        "bundle.corner_rows": (state, corners),
        "bundle.unfolding_rows": (_a(8), False, priors),
        "bundle.radial_slopes": (_a(4), False, _a(3)),
        "bundle.standardised": (_a(4, 2), _a(4, 2, 6), np.ones(4, bool), _whole(0, 2, 4)),
        "bundle.homography": (_a(6, 2), _a(6, 2), _whole(0, 1, 2, 3)[None], 1.0),
        "bundle.corner_radius": (_a(8), 640.0, 480.0),
        "antenna.curves": (2, *presses),
        "antenna.bend": (False, 2, *presses),
        "antenna.bend_lanes": (3, *lanes, _a(3, nodes, 8), _a(3, nodes, 8), _a(3, 8), _a(8)),
        "antenna.universal_curve": (_a(3, 4), _a(3)),
        "antenna.closed_form": (1.0, 0.1),
        "antenna.jacobi": (1.0, 0.1),
        "antenna.solve_rods": (rod, _a(2, 7), 1.0, _a(2, 2), _a(2, 3), 4),
        "antenna.shoot_rods": (rod, _a(2, 7), _a(2, 3), 4),
        "antenna.solve_touched_twice": (uniform, _a(2, 11), 0.0, _a(2, 5), 4),
        "simulate.signed_distances": (object_, _a(3, 3)),
        "simulate.rough_distances": (object_, _a(3, 3)),
        "simulate.elevations": (_a(3, 3), 1.0, _a(2, 5)),
        "simulate.surface_radii": (_a(3, 3), 1.0, _a(2, 5)),
        "simulate.first_within": (object_, _a(2, 3, 3), _a(2, 3), _a(4, 3), _a(4)),
        "simulate.cast_rays": (body, _a(3), _a(4, 3)),
        "simulate.shade": (_a(3), _a(3), _a(4, 3), _a(4), _a(4)),
        "simulate.rays_between": (_a(5, 6, 2), _a(4, 2)),
        "simulate.surroundings": (_a(5, 6, 2), np.eye(3), np.float32(_a(8, 8)), 1.0),
        "simulate.sheet_pixels": (_a(5, 6, 2), (1, 0, 2, 3, 2), np.eye(3), np.ones((4, 5, 2), np.uint16), 1.0),
        "simulate.blurred_change": (*np.float32(_a(1, 9, 8)), *np.float32(_a(2, 6, 4)), (3, 4, 2), 0.7),
        "simulate.digitised": (np.float32(_a(3, 4)), 40.0, 1.2, 7),
        "simulate.spline": (np.arange(5.0), _a(5, 3), _a(4)),
        "simulate.tube_pixels": (9.0 * _a(5, 7), 20, 10, _a(4, 2), 2, 0.1),
        "simulate.touch_at_once": (rod, (1.0,) * 5, _a(2, 9, 3), _a(2, 2, 7), _a(2, 7)),
        "simulate.advance": (rod, object_, (1.0,) * 5, _a(2, 7, 3), _a(2, 2, 23)),
        "simulate.gripped": (_a(2), _a(2), _a(2, 2), 1.0, _a(2), 0.3),
        "solver.Rig": (fields, cameras),
        "solver.solve": (rig, exact, frames, 0, 3, -1, _a(3, 4), _a(pieces), FitNumbers.unwritten(3)),
        "solver.rough": (rig, frames, _a(3, 4), _a(3, nodes, 3)),
        "solver.linearise": (rig, frames, 1, _a(3, 4), linearised),
        "solver.gradients": (rig, frames, 1, _a(3, 4), np.ones(3), np.zeros(3, bool)),
        "solver.free_antennas": (rig, frames, _a(3, 9), 3.0, antennas),
        "solver.edge_on": (rig, _a(3, 4)),
        "solver.ideal_points": (LENS, _a(3, 2), _a(3)),
        "solver.places": (_a(3, 5, 2),),
        "solver.accelerations": (np.arange(9.0), _a(9, 2, 3), _a(9, 1), _whole(4), _a(1), 2.0, 4, False),
        "profile.to_its_end": (image, path, 9, core.profile.expected(3.0, 0.8, 11), 1),
        "search.fit_smooth": (_a(5), _a(5), _a(5), [1.0, 0.5], 4, 0.1),
        "search.solve_definite": (np.eye(3), _a(3, 2)),
        "search.running_mean": (_a(9), 3, core.search.Beyond.mirrored),
        "search.running_medians": (_a(9), 4),
        "search.running_maxima": (_a(9), 4),
        "search.triangle_sums": (_a(9, 2), 3),
        "search.ribbon_evidence": (planes, 3.5, _a(3), _a(3), 50.0, (0.7, 0.2, 0.05), -2.5),
        "search.best_paths": (
            *ribbons,
            np.array([[20.0, 2.0]]),
            np.array([[20.0, 33.0]]),
            (1.0, 2.5, 0.02, 0.15, 9.0, 3.0, 2.0, 90.0, 5.0),
            (1.5, 8.0),
            4,
        ),
        "surface.covariance": (
            _fields(x=(3, 2), value=(3, 1), slope=(3, 1, 2)),
            _fields(x=(9, 2), value=(9, 1), slope=(9, 1, 2)),
            SimpleNamespace(length_m=0.1, amplitude_m=0.01, offset_m=1.0, incline=2.0),
            True,
        ),
        "search.quantile": (_a(9), 0.4),
        "search.median": (_a(9),),
        "search.normals": (path,),
        "search.resample": (path, 2.0),
        "search.nearest_on": (path, _a(3, 2)),
        "search.crossings": (image, path, 9, 1.0),
        "search.refine_path": (image, path, 4.0, 12.0, 1.0),
        "search.places": (paths, 2, 2, (15, 20)),
        "search.ridge_responses": (image, 4, 2, 0),
        "search.scores": (image.ravel(), RNG.integers(0, 99, (3, 5), np.int32), _a(3)),
        "search.clearest_paths": (_a(2), paths, 3.0, 2, 0.5),
        "search.bent": (free, (0.1, 0.1, 0.5, 0.1, 0.5)),
        "search.likely_shapes": (
            colour,
            np.linspace([5.0, 30.0], [70.0, 30.0], 12),
            np.linspace([5.0, 30.0], [70.0, 30.0], 12)[None] + np.zeros((3, 12, 2)),
            3.0,
            4.0,
            np.array([0.5, 1.1]),
            (1.5, 0.1),
            _a(8, 4),
            SearchSettings(),
            2,
        ),
        "search.nearest_shape": (free, _a(7, 2), _a(7), (0.1, 0.1, 0.5), 0.0, _a(2, 5)),
        "search.means_of_runs": (_a(9, 2), _a(9), 4),
        "search.colours_at": (colour, 255.0, path),
        "search.foreign": (colour, 255.0, path, np.linspace(0.0, 1.0, 9), looks),
        "profile.expected": (4.0, 0.8, 11),
        "profile.shapes": (4.0, 0.8, 11),
        "profile.fit": (core.profile.expected(4.0, 0.8, 11), found, np.zeros(len(found.along))),
        "profile.stiffened": (path,),
        "profile.measured": (image, path, 4.0, 9, 1, -0.5, 0.6, core.profile.shapes(4.0, 0.8, 11)),
        "profile.measured_ribbon": (colour, path, 4.0, 0.8, 9, RibbonSettings()),
        "profile.shades": (4.0, 0.8, 11),
        "profile.normal_equations": (found, np.zeros(len(found.along)), 4.0, 0.8, _a(len(found.along), 4), 11),
        "profile.blurred_polynomials": (4.0, 0.8, 11),
    }


CALLS = _calls()
WHOLE, REAL = (-1, 0, 1, 3, 2**31 - 1, -(2**31), 2**40), (np.nan, np.inf, -np.inf, -1.0, 0.0, 1e300, 1e-300, 3.0)


def _spoilt(value: Any, rng: np.random.Generator) -> Any:
    """Another number, another kind of array, another shape, or other entries."""
    if isinstance(value, np.ndarray):
        entries, axis = value.copy(), int(rng.integers(max(value.ndim, 1)))
        some = rng.random(value.shape) < rng.choice([0.1, 1.0])
        entries[some] = rng.choice(REAL if value.dtype.kind == "f" else WHOLE[:4])
        return [
            entries,
            entries,
            value.astype(rng.choice(["f4", "i8", "c16", "?", "u1", "f8", ">f8"])),
            np.repeat(value, 2, axis=axis)[(*[slice(None)] * axis, slice(None, None, 2))],
            np.take(value, range(value.shape[axis] - 1), axis) if value.ndim else value,
            np.repeat(value, 2, axis=axis) if value.ndim else value,
            np.asarray(value.T, order="C"),
            value.reshape(1, -1)[:, : rng.integers(1 + value.size)],
            value.reshape(*value.shape[:axis], -1, *([1] * (value.ndim - axis - 1))),
            value[..., None],
            np.empty((*value.shape[:axis], 0, *value.shape[axis + 1 :]), value.dtype),
            np.empty((2**40, 0)),
            None,
        ][rng.integers(13)]
    if isinstance(value, bool):
        return None if rng.random() < 0.5 else not value
    if isinstance(value, int | float):
        numbers = WHOLE if isinstance(value, int) and rng.random() < 0.8 else REAL
        return numbers[rng.integers(len(numbers))]
    if isinstance(value, tuple | list):
        return [*value[:-1], _spoilt(value[-1], rng)]
    if hasattr(value, "__dict__"):
        kept = dict(vars(value))
        name = rng.choice(list(kept))
        return SimpleNamespace(**kept | {name: _spoilt(kept[name], rng)})
    return LENS


def test_every_function_has_a_right_call() -> None:
    assert set(FUNCTIONS) <= set(CALLS)


@pytest.mark.filterwarnings("ignore:.*encountered in cast:RuntimeWarning")
@pytest.mark.parametrize("name", CALLS)
def test_wrong_calls_are_refused_or_answered(name: str) -> None:
    """One or two arguments are spoilt: an error of Python's or any answer, but never a crash."""
    room, _, call = name.partition(".")
    if room == "Lens":
        function = core.lens.Lens if call == "__init__" else getattr(LENS, call)
    else:
        function = getattr(getattr(core, room), call)
    rng = np.random.default_rng(len(name))
    function(*CALLS[name])
    for _ in range(TRIES):
        arguments = list(CALLS[name])
        for at in rng.permutation(len(arguments))[: rng.integers(1, 3)]:
            arguments[at] = _spoilt(arguments[at], rng)
        with suppress(TypeError, ValueError, AttributeError, MemoryError):
            function(*arguments)


@pytest.mark.slow
def test_zig_builds_it_where_there_is_no_compiler(tmp_path: Path) -> None:
    """Minutes: zig builds its C++ library first."""
    pytest.importorskip("nanobind")
    tools, build = tmp_path / "tools", tmp_path / "build"
    subprocess.run([sys.executable, "-m", "pip", "-q", "install", "--target", str(tools), "ziglang"], check=True)
    variables = {}
    for name, variable in (("c++", "CXX"), ("cc", "CC")):
        script = tmp_path / f"zig-{name}"
        script.write_text(f'#!/bin/sh\nexec "{tools}/ziglang/zig" {name} -mcpu=baseline "$@"\n')
        script.chmod(0o755)
        variables[variable] = str(script)
    cmake = ["cmake", "-S", str(ROOT / "vbaa_calib/native"), "-B", str(build), "-G", "Ninja", "-DLEVELS=base"]
    environment = (
        os.environ | variables | {"PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])}
    )
    subprocess.run([*cmake, f"-DPython_EXECUTABLE={sys.executable}"], env=environment, check=True)
    subprocess.run(["cmake", "--build", str(build)], env=environment, check=True)
    found = subprocess.run(
        [sys.executable, "-c", "import core; print(*dir(core))"],
        cwd=build / "base",
        capture_output=True,
        text=True,
        check=True,
    )
    assert {name.partition(".")[0] for name in FUNCTIONS} <= set(found.stdout.split())
