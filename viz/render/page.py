"""The page of a scene: VTK's offline viewer draws it; legend, time slider and colours are ours."""

from __future__ import annotations

import base64
import io
import json
import zipfile
from html import escape
from pathlib import Path
from typing import Any

import cv2
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

from vbaa_calib.core.files import write_text
from viz.pages.page import render
from viz.parts.assemble import ScenePart, all_parts, layers_of
from viz.scene.readable import MODES, contact_scale, object_scale
from viz.scene.scene import Scene

from .stage import Stage, quiet

_CLEAR = "max(t2Color,0.00001)"
"""In the viewer's shader, in place of 0.01: the weight below which it draws what is seen through as black. What is far
off or nearly clear weighs less, and would lose its colour."""
_ICON = "https://kitware.github.io/vtk-js/icon/favicon-${t}x${t}.png"
"""What the viewer would ask for from elsewhere."""


@quiet()
def write_page(scene: Scene, path: Path, *, title: str, mode: str = "force", force: bool = False) -> None:
    """Write an HTML page with the interactive scene, a time slider and a legend.

    It opens offline, in any browser with WebGL; OpenGL is not needed to write it. Raises InputError when the file
    exists and `force` is off.
    """
    stage = Stage(scene, all_parts(scene), mode)
    camera, views = stage.plotter.camera, []
    if scene.rig is not None:
        stage.look_at_all()
        views.append((camera.position, camera.focal_point))
    stage.look_at_contacts(parallel=False)
    views.append((camera.position, camera.focal_point))
    stage.unfold()
    packed, instants = _packed(stage.plotter), scene.instants
    seen, pictures = _pictures(scene)
    scales = {name: contact_scale(scene, name) for name in MODES}
    data = {
        "main": instants.main,
        "mode": mode,
        "times": np.round(instants.time_s, 4).tolist(),
        "frames": instants.frame.tolist(),
        "words": list(instants.words),
        "parts": [_part(part, reference_id(actor)) for part, actor in zip(stage.parts, stage.actors, strict=True)],
        "modes": [
            {"name": name, "rgb": _base64(scale.rgb.tobytes()), "gradient": scale.gradient, "ends": scale.ends}
            for name, scale in scales.items()
        ],
        "views": [{"position": list(map(float, at)), "focus": list(map(float, to))} for at, to in views],
        "seen": seen,
        "pictures": pictures,
        "lines": _lines(scene) if len(seen) > 1 else [],
        "contacts": _contacts(scene),
    }
    stage.plotter.close()
    cards = render(
        "scene.html.j2",
        title=title,
        contacts=len(scene.contacts.points_m),
        modes=MODES,
        object_scale=object_scale(scene),
        rig=scene.rig is not None,
        layers=layers_of(stage.parts),
        facts=scene.facts,
        last=len(instants) - 1,
        data=data,
    )
    viewer = io.StringIO()
    write_html(packed, viewer)
    html = viewer.getvalue().replace("max(t2Color,0.01)", _CLEAR).replace(_ICON, "data:,")
    # The page stands alone: it loads nothing, and sends nothing anywhere.
    alone = (
        "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' data: blob:; style-src 'unsafe-inline'; "
        "img-src data: blob:; font-src data:; connect-src data: blob:; worker-src blob:; base-uri 'none'; "
        "form-action 'none'"
    )
    policy = f'<meta http-equiv="Content-Security-Policy" content="{alone}">'
    start, end = html.index("<title>"), html.index("</title>")
    head, body, rest = (html[:start] + policy + f"<title>{escape(title)}" + html[end:]).partition("<body>")
    write_text(path, f"{head}<style>{render('scene.css')}</style>{body}{cards}{rest}", force)


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()


def _contacts(scene: Scene) -> dict[str, Any]:
    """Positions of the contacts, radii of their spheres, the instants nearest to their frames, covariances, and
    numbers in words."""
    contacts = scene.contacts
    nearest = np.abs(scene.instants.row[:, None] - contacts.row).argmin(axis=0)
    return {
        "points": np.round(contacts.points_m, 7).tolist(),
        "radius": scene.ball_m,
        "covariances": [None if not np.isfinite(one).all() else one.ravel().tolist() for one in contacts.covariance_m2],
        "moments": nearest.tolist(),
        "words": contacts.words,
    }


def _part(part: ScenePart, identity: str) -> dict[str, Any]:
    data: dict[str, Any] = {"id": identity, "name": part.name, "textured": part.textured}
    if part.span is not None:
        data |= {"span": part.span.tolist(), "history": part.history}
    if part.poses is not None:
        # by columns, as WebGL has them
        data["poses"] = [
            np.round(pose.T.ravel(), 6).tolist() if np.isfinite(pose).all() else None for pose in part.poses
        ]
    if part.contact is not None:
        data["contacts"] = part.contact.tolist()
    return data


def _pictures(scene: Scene) -> tuple[list[str], list[int | None]]:
    """The distinct pictures as data URIs, and the index of each instant's."""
    different = {id(picture): picture for picture in scene.pictures if picture is not None}
    order = {identity: index for index, identity in enumerate(different)}
    seen = []
    for picture in different.values():
        _, jpeg = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 80])
        seen.append("data:image/jpeg;base64," + _base64(jpeg.tobytes()))
    return seen, [order.get(id(picture)) for picture in scene.pictures] or [None] * len(scene.instants)


def _lines(scene: Scene) -> list[list[list[float]]]:
    """At each instant the image coordinates of the fitted antenna and, as the last point, of the contact if there is
    one."""
    if scene.rig is None:
        return []
    known = np.isfinite(scene.rig.seen).all(axis=-1)
    return [
        np.round(one[inside], 4).tolist() if inside[-1] else []
        for one, inside in zip(scene.rig.seen, known, strict=True)
    ]


def _packed(plotter: pv.Plotter) -> bytes:
    """The render window as the archive for trame-vtk's offline viewer."""
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
    """Make the viewer's textures writable again, so that the camera's picture can change with time."""
    if state.get("type") == "vtkTexture":
        state["properties"]["resizable"] = True
    for child in state.get("dependencies", []):
        _let_textures_change(child)
