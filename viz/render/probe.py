"""Whether 3-D pictures can be drawn here: OpenGL is tried in a process of its own, which it may crash.

`python -m viz.render.probe`: exit code 0 where it works, 1 where not.
"""

from __future__ import annotations

import functools
import subprocess
import sys

from vbaa_calib.core.errors import VbaaError

PROBE = (
    sys.executable,
    "-c",
    """
import vtkmodules.vtkRenderingOpenGL2
from vtkmodules.vtkFiltersSources import vtkSphereSource
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper, vtkRenderer, vtkRenderWindow
ball, mapper, actor = vtkSphereSource(), vtkPolyDataMapper(), vtkActor()
mapper.SetInputConnection(ball.GetOutputPort())
actor.SetMapper(mapper)
renderer, window = vtkRenderer(), vtkRenderWindow()
renderer.AddActor(actor)
window.SetOffScreenRendering(True)
window.SetSize(32, 32)
window.AddRenderer(renderer)
window.Render()
""",
)
"""Draws a ball with VTK alone: pyvista takes a second to load."""


@functools.cache
def can_render() -> bool:
    """Whether OpenGL works here, tried in a process of its own: without a driver VTK ends the process."""
    try:
        tried = subprocess.run(PROBE, capture_output=True, timeout=60, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return tried.returncode == 0


def require_opengl() -> None:
    """Raises VbaaError, with what to install, where OpenGL does not work."""
    if not can_render():
        raise VbaaError(
            "3-D pictures need OpenGL, which does not work here; install libegl1 and libgl1-mesa-dri "
            "(apt-get install libegl1 libgl1-mesa-dri), or libosmesa6; --html and --gltf work without"
        )


if __name__ == "__main__":
    sys.exit(not can_render())
