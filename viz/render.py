"""Pictures of a scene: PNG, a page that opens offline, a window. OpenGL is probed before it can kill the process."""

from __future__ import annotations

import functools
import io
import json
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pyvista as pv
from trame_vtk.modules.vtk.serializers import (
    SynchronizationContext,
    extract_array_hash,
    initialize_serializers,
    reference_id,
    serialize,
)
from trame_vtk.tools.vtksz2html import write_html
from vtkmodules.vtkCommonCore import vtkLogger

from vbaa_calib.errors import InputError, VbaaError
from vbaa_calib.files import replacing, write_text

from . import actors
from .page import dressed
from .scene import Scene

PROBE = (
    sys.executable,
    "-c",
    "import pyvista as pv; p = pv.Plotter(off_screen=True, window_size=(32, 32)); p.add_mesh(pv.Sphere()); "
    "p.screenshot(return_img=True)",
)
PROBE_SECONDS = 60
BACKGROUND, BACKGROUND_TOP = "#ffffff", "#e8eef6"


class OpenGLError(VbaaError):
    """This machine cannot draw in three dimensions."""


@functools.cache
def can_render() -> bool:
    """Whether OpenGL works here. Tried in a process of its own: without a driver VTK ends the one that asks."""
    try:
        tried = subprocess.run(PROBE, capture_output=True, timeout=PROBE_SECONDS, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return tried.returncode == 0


def require_opengl() -> None:
    """Raises OpenGLError, with what to install, where pictures cannot be drawn."""
    if not can_render():
        raise OpenGLError(
            "3-D pictures need OpenGL, which does not work here; install libegl1 and libgl1-mesa-dri "
            "(apt-get install libegl1 libgl1-mesa-dri), or libosmesa6; --html works without"
        )


def screenshot(scene: Scene, path: Path, *, force: bool = False) -> None:
    """Write a PNG: the whole rig on the left, what was touched on the right.

    Raises
    ------
    InputError : the file exists and `force` is off, or its name does not end in .png.
    OpenGLError : pictures cannot be drawn here.
    """
    if Path(path).suffix.lower() != ".png":
        raise InputError("is not a .png", where=path, remedy="name it something.png")
    with replacing(path, force) as temporary:
        require_opengl()
        with _quiet():
            plotter = _two_views(scene) if scene.rig else pv.Plotter(off_screen=True, window_size=[1200, 1040])
            _fill(plotter, scene, scalar_bar=True)
            actors.look_at_touched(plotter, scene)
            plotter.screenshot(str(temporary))
            plotter.close()


def _two_views(scene: Scene) -> pv.Plotter:
    """The rig on the left, drawn; the view on the right active and still empty."""
    plotter = pv.Plotter(
        off_screen=True, shape=(1, 2), col_weights=[0.42, 0.58], window_size=[1900, 1040], border=False
    )
    plotter.subplot(0, 0)
    _fill(plotter, scene, scalar_bar=False)
    _legend(plotter, scene)
    actors.look_at_all(plotter, lift=0.16)
    plotter.subplot(0, 1)
    return plotter


def write_page(scene: Scene, path: Path, *, title: str, force: bool = False) -> None:
    """Write an HTML page with the scene to turn and zoom, and its legend. It opens offline; OpenGL is not needed."""
    with _quiet():
        plotter = pv.Plotter(off_screen=True, window_size=[1200, 800])
        plotter.set_background(BACKGROUND)
        actors.add_scene(plotter, scene, scalar_bar=False)
        actors.look_at_all(plotter)
        packed = _packed(plotter)
        plotter.close()
    viewer = io.StringIO()
    write_html(packed, viewer)
    write_text(path, dressed(viewer.getvalue(), scene, title), force)


def show(scene: Scene) -> None:
    """Open a window and wait until it is closed. Raises OpenGLError where nothing can be drawn."""
    require_opengl()
    plotter = pv.Plotter(title="vbaa", window_size=[1400, 1000])
    _fill(plotter, scene, scalar_bar=True)
    _legend(plotter, scene)
    actors.look_at_all(plotter)
    plotter.show()


def _fill(plotter: pv.Plotter, scene: Scene, *, scalar_bar: bool) -> None:
    plotter.set_background(BACKGROUND, top=BACKGROUND_TOP)
    plotter.enable_anti_aliasing("ssaa")
    plotter.enable_depth_peeling(8)
    actors.add_scene(plotter, scene, scalar_bar=scalar_bar)
    plotter.add_axes(color=actors.INK, line_width=3, viewport=(0.85, 0.0, 1.0, 0.15))


def _legend(plotter: pv.Plotter, scene: Scene) -> None:
    entries = [[f" {actors.LOOK[part][1]}", actors.LOOK[part][0]] for part in actors.parts(scene)]
    plotter.add_legend(
        entries, face="rectangle", bcolor=None, loc="lower left", size=(0.5, 0.027 * len(entries)), font_family="arial"
    )


def _packed(plotter: pv.Plotter) -> bytes:
    """The render window as the archive that the offline viewer of trame-vtk opens."""
    initialize_serializers()
    context, window = SynchronizationContext(), plotter.render_window
    state = serialize(None, window, reference_id(window), context, 0)
    camera = plotter.camera
    state["extra"] = {
        "vtkRefId": reference_id(window),
        "centerOfRotation": list(camera.focal_point),
        "camera": reference_id(camera),
    }
    arrays = {
        entry["hash"]: {**entry, "content": context.get_cached_data_array(entry["hash"], False)}
        for entry in extract_array_hash(state)
    }
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as stream:
        stream.writestr("index.json", json.dumps({"scene": state, "hashes": arrays}))
    return archive.getvalue()


@contextmanager
def _quiet() -> Iterator[None]:
    """VTK warns on stderr when it looks for a display first and finds none; that is no news to anyone."""
    before = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(before)
