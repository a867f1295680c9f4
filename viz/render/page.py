"""The page of a scene: VTK's offline viewer draws it; legend, time and colours around it are ours."""

from __future__ import annotations

import base64
from html import escape
from typing import Any

import cv2
import numpy as np
from trame_vtk.modules.vtk.serializers import reference_id

from viz.pages.page import render
from viz.parts import Part, layers_of
from viz.scene.colours import MODES, Scale, contact_scale, object_scale
from viz.scene.scene import Scene

from .stage import Stage

_JPEG_QUALITY = 80
DARKENED, CLEAR = "max(t2Color,0.01)", "max(t2Color,0.00001)"
"""In the viewer's shader: the weight below which it draws what is seen through as black. What is far off or nearly
clear weighs less, and would lose its colour."""


def page_data(stage: Stage, mode: str, views: list[tuple[np.ndarray, np.ndarray]]) -> dict[str, Any]:
    """Data of the page's script: parts by the viewer's ids, moments, colours, points of view (position, focus)."""
    scene, instants = stage.scene, stage.scene.instants
    seen, pictures = _pictures(scene)
    return {
        "main": instants.main,
        "mode": mode,
        "times": np.round(instants.time_s, 4).tolist(),
        "frames": instants.frame.tolist(),
        "words": list(instants.words),
        "parts": [_part(part, reference_id(actor)) for part, actor in zip(stage.parts, stage.actors, strict=True)],
        "modes": [_mode(name, contact_scale(scene, name)) for name in MODES],
        "views": [{"position": list(map(float, at)), "focus": list(map(float, to))} for at, to in views],
        "seen": seen,
        "pictures": pictures,
    }


def _mode(name: str, scale: Scale) -> dict[str, Any]:
    rgb = base64.b64encode(scale.rgb.tobytes()).decode()
    return {"name": name, "rgb": rgb, "gradient": scale.gradient, "ends": scale.ends}


def _part(part: Part, identity: str) -> dict[str, Any]:
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
    """The different pictures as data URIs, and which of them each instant has."""
    different = {id(picture): picture for picture in scene.pictures if picture is not None}
    order = {identity: index for index, identity in enumerate(different)}
    seen = []
    for picture in different.values():
        _, jpeg = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
        seen.append("data:image/jpeg;base64," + base64.b64encode(jpeg.tobytes()).decode())
    return seen, [order.get(id(picture)) for picture in scene.pictures] or [None] * len(scene.instants)


def scene_page(viewer_html: str, scene: Scene, parts: list[Part], title: str, data: dict[str, Any]) -> str:
    """The viewer's page with our title, cards and script in it."""
    cards = render(
        "scene.html.j2",
        title=title,
        contacts=len(scene.contacts.points_m),
        modes=MODES,
        object_scale=object_scale(scene),
        rig=scene.rig is not None,
        layers=layers_of(parts),
        facts=scene.facts,
        last=len(scene.instants) - 1,
        data=data,
    )
    viewer_html = viewer_html.replace(DARKENED, CLEAR)
    start, end = viewer_html.index("<title>"), viewer_html.index("</title>")
    head, body, rest = (viewer_html[:start] + f"<title>{escape(title)}" + viewer_html[end:]).partition("<body>")
    return f"{head}<style>{render('scene.css')}</style>{body}{cards}{rest}"
