"""Pictures of a scene: PNG, a page that opens offline, glTF, a window.

OpenGL is probed before it can kill the process."""

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
from typing import Any

import numpy as np
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

from vbaa_calib.core.errors import VbaaError
from vbaa_calib.core.files import replacing, write_text
from viz.parts import Part, all_parts
from viz.parts.part import INK
from viz.scene.scene import Scene
from viz.scene.views import look_at_all, look_at_contacts

from . import gltf, sheet, window
from .page import page_data, scene_page
from .stage import Stage

PROBE = (
    sys.executable,
    "-c",
    "import pyvista as pv; p = pv.Plotter(off_screen=True, window_size=(32, 32)); p.add_mesh(pv.Sphere()); "
    "p.screenshot(return_img=True)",
)
_PROBE_SECONDS = 60
_BACKGROUND = "#ffffff"


class OpenGLError(VbaaError):
    """This machine cannot draw in three dimensions."""


@functools.cache
def can_render() -> bool:
    """Whether OpenGL works here. Tried in a process of its own: without a driver VTK ends the one that asks."""
    try:
        tried = subprocess.run(PROBE, capture_output=True, timeout=_PROBE_SECONDS, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return tried.returncode == 0


def require_opengl() -> None:
    """Raises OpenGLError, with what to install, where pictures cannot be drawn."""
    if not can_render():
        raise OpenGLError(
            "3-D pictures need OpenGL, which does not work here; install libegl1 and libgl1-mesa-dri "
            "(apt-get install libegl1 libgl1-mesa-dri), or libosmesa6; --html and --gltf work without"
        )


def screenshot(scene: Scene, path: Path, *, mode: str = "force", force: bool = False) -> None:
    """Write a PNG: the whole rig on the left, what was touched on the right, and what the colours mean.

    `mode` is what contacts are coloured by, one of `colours.MODES`. Raises InputError when the file exists and `force`
    is off, OpenGLError where pictures cannot be drawn.
    """
    with replacing(path, force) as temporary:
        require_opengl()
        with _quiet():
            parts = all_parts(scene)
            plotter = _staged(scene, _without(parts, "grid", "plane", "camera", "now"), mode, sheet.NEAR_SIZE)[0]
            half = look_at_contacts(plotter, scene)
            near = _drawn(plotter), half
            whole = None
            if scene.rig is not None:
                plotter = _staged(scene, _without(parts, "spread", "cones", "now"), mode, sheet.RIG_SIZE)[0]
                look_at_all(plotter, scene)
                whole = _drawn(plotter)
        sheet.compose(temporary, scene, parts, mode, near, whole)


def write_page(scene: Scene, path: Path, *, title: str, mode: str = "force", force: bool = False) -> None:
    """Write an HTML page with the scene to turn, its times to go through, and its legend.

    It opens offline, in any browser with WebGL; OpenGL is not needed to write it.
    """
    with _quiet():
        plotter, stage = _staged(scene, all_parts(scene), mode, (1200, 800))
        views = []
        if scene.rig is not None:
            look_at_all(plotter, scene)
            views.append((plotter.camera.position, plotter.camera.focal_point))
        look_at_contacts(plotter, scene, parallel=False)
        views.append((plotter.camera.position, plotter.camera.focal_point))
        stage.unfold()
        packed = _packed(plotter)
        data = page_data(stage, mode, views)
        plotter.close()
    viewer = io.StringIO()
    write_html(packed, viewer)
    write_text(path, scene_page(viewer.getvalue(), scene, stage.parts, title, data), force)


def write_gltf(scene: Scene, path: Path, *, mode: str = "force", force: bool = False) -> None:
    """Write a .gltf or .glb with all contacts, and the rig at the greatest force; y is up. OpenGL is not needed.

    Raises InputError when the file exists and `force` is off.
    """
    with _quiet():
        plotter, stage = _staged(scene, _without(all_parts(scene), "now"), mode, (1200, 800))
        look_at_all(plotter, scene)
        shown = [part.name for part, actor in zip(stage.parts, stage.actors, strict=True) if actor.visibility]
        made = gltf.packed(*gltf.document(plotter, shown), path.suffix.lower())
        plotter.close()
    with replacing(path, force) as temporary:
        temporary.write_bytes(made)


def show(scene: Scene, *, mode: str = "force") -> bool:
    """Open a window and wait until it is closed; False where none opens. Raises OpenGLError."""
    require_opengl()
    with _quiet():
        plotter, stage = _staged(scene, all_parts(scene), mode, (1400, 1000), off_screen=False)
    # VTK turns to drawing unseen where no window opens
    if plotter.render_window.GetOffScreenRendering():
        plotter.close()
        return False
    window.add_controls(plotter, stage, mode)
    look_at_all(plotter, scene)
    plotter.show()
    return True


def _staged(
    scene: Scene, parts: list[Part], mode: str, size: tuple[int, int], *, off_screen: bool = True
) -> tuple[pv.Plotter, Stage]:
    plotter = pv.Plotter(off_screen=off_screen, window_size=list(size), title="vbaa")
    plotter.set_background(_BACKGROUND)
    return plotter, Stage(plotter, scene, parts, mode)


def _without(parts: list[Part], *names: str) -> list[Part]:
    return [part for part in parts if part.name not in names]


def _drawn(plotter: pv.Plotter) -> np.ndarray:
    """(H, W, 3) of what the plotter shows, which it then closes."""
    plotter.enable_anti_aliasing("ssaa")
    plotter.enable_depth_peeling(8)
    plotter.add_axes(color=INK, line_width=3, viewport=(0.0, 0.0, 0.13, 0.13))
    pixels = plotter.screenshot(return_img=True)
    plotter.close()
    return np.asarray(pixels)[..., :3]


def _packed(plotter: pv.Plotter) -> bytes:
    """The render window as the archive that the offline viewer of trame-vtk opens."""
    initialize_serializers()
    context, window = SynchronizationContext(), plotter.render_window
    state = serialize(None, window, reference_id(window), context, 0)
    centre, camera = list(plotter.camera.focal_point), reference_id(plotter.camera)
    state["extra"] = {"vtkRefId": reference_id(window), "centerOfRotation": centre, "camera": camera}
    _let_textures_change(state)
    arrays = {
        entry["hash"]: {**entry, "content": context.get_cached_data_array(entry["hash"], False)}
        for entry in extract_array_hash(state)
    }
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as stream:
        stream.writestr("index.json", json.dumps({"scene": state, "hashes": arrays}))
    return archive.getvalue()


def _let_textures_change(state: dict[str, Any]) -> None:
    """Let the viewer's textures be written again, for the camera's picture to change with time."""
    if state.get("type") == "vtkTexture":
        state["properties"]["resizable"] = True
    for child in state.get("dependencies", []):
        _let_textures_change(child)


@contextmanager
def _quiet() -> Iterator[None]:
    """VTK warns on stderr when it looks for a display first and finds none; that is no news to anyone."""
    before = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(before)
