"""The page of a scene: VTK's offline viewer draws it; legend, time and colours around it are ours."""

from __future__ import annotations

import base64
import json
from html import escape
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from trame_vtk.modules.vtk.serializers import reference_id

from viz.parts import Part
from viz.scene.colours import MODES, Scale, contact_scale, object_scale
from viz.scene.scene import Scene

from .stage import Stage

JPEG_QUALITY = 80
DARKENED, CLEAR = "max(t2Color,0.01)", "max(t2Color,0.00001)"
"""In the viewer's shader: the weight below which it draws what is seen through as black. What is far off or nearly
clear weighs less, and would lose its colour."""


def story(stage: Stage, mode: str, views: list[tuple[np.ndarray, np.ndarray]]) -> dict[str, Any]:
    """What the page's script needs: parts by the viewer's ids, moments, colours, points of view (position, focus)."""
    scene, moments = stage.scene, stage.scene.moments
    seen, pictures = _pictures(scene)
    return {
        "main": moments.main,
        "mode": mode,
        "times": np.round(moments.time_s, 4).tolist(),
        "frames": moments.frame.tolist(),
        "words": list(moments.words),
        "parts": [_part(part, reference_id(actor)) for part, actor in zip(stage.parts, stage.actors, strict=True)],
        "modes": [_mode(name, contact_scale(scene, name)) for name in MODES],
        "views": [{"position": list(map(float, at)), "focus": list(map(float, to))} for at, to in views],
        "seen": seen,
        "pictures": pictures,
    }


def _part(part: Part, identity: str) -> dict[str, Any]:
    told: dict[str, Any] = {"id": identity, "name": part.name}
    if part.span is not None:
        told |= {"span": part.span.tolist(), "history": part.history}
    if part.poses is not None:
        # by columns, as WebGL has them
        told["poses"] = [
            np.round(pose.T.ravel(), 6).tolist() if np.isfinite(pose).all() else None for pose in part.poses
        ]
    if part.contact is not None:
        told["contacts"] = part.contact.tolist()
    if part.textured:
        told["textured"] = True
    return told


def _mode(name: str, scale: Scale) -> dict[str, str]:
    return {
        "name": name,
        "rgb": base64.b64encode(scale.rgb.tobytes()).decode(),
        "gradient": _gradient(scale),
        "ends": _ends(scale),
    }


def _gradient(scale: Scale) -> str:
    return f"linear-gradient(to right, {', '.join(scale.stops)})"


def _ends(scale: Scale) -> str:
    return f"<span>{scale.low:.4g}</span><span>{scale.title}, {scale.unit}</span><span>{scale.high:.4g}</span>"


def _pictures(scene: Scene) -> tuple[list[str], list[int | None]]:
    """The different pictures as data URIs, and which of them each moment has."""
    seen: list[str] = []
    known: dict[int, int] = {}
    which: list[int | None] = []
    for picture in scene.pictures:
        if picture is not None and id(picture) not in known:
            known[id(picture)] = len(seen)
            _, jpeg = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
            seen.append("data:image/jpeg;base64," + base64.b64encode(jpeg.tobytes()).decode())
        which.append(None if picture is None else known[id(picture)])
    return seen, which or [None] * len(scene.moments)


def _swatch(part: Part, scene: Scene) -> str:
    """The attributes of a legend's mark: what the contacts are coloured by follows the choice."""
    if part.contact is not None:
        return 'class="chosen"'
    scale = object_scale(scene) if part.name == "object" else None
    return f'style="background:{part.colour if scale is None else _gradient(scale)}"'


def _legend(scene: Scene, parts: list[Part], title: str) -> str:
    """The card with scales, layers to switch, points of view and what was found."""
    layers: dict[str, Part] = {}
    for part in parts:
        if part.name not in layers or len(part.label) > len(layers[part.name].label):
            layers[part.name] = part
    rows = "".join(
        f'<label><input type="checkbox" checked data-layer="{name}"><i {_swatch(part, scene)}></i>'
        f"{escape(part.label)}</label>"
        for name, part in layers.items()
    )
    choices = "".join(f"<option>{name}</option>" for name in MODES)
    scale = object_scale(scene)
    surface = ""
    if scale is not None:
        surface = f'<div class="scale"><div style="background:{_gradient(scale)}"></div><p>{_ends(scale)}</p></div>'
    facts = "".join(f"<li>{escape(fact)}</li>" for fact in (scene.estimate.facts if scene.estimate is not None else ()))
    views = '<button type="button">what was touched</button>'
    if scene.rig is not None:
        views = f'<button type="button">whole rig</button>{views}'
    return (
        f'<div class="card" id="legend"><h1>{escape(title)}</h1>'
        f'{len(scene.contacts.points_m)} contacts, coloured by <select id="mode">{choices}</select>'
        f'<div class="scale"><div id="colours"></div><p id="ends"></p></div>{surface}'
        f'<div id="views">{views}</div>{rows}'
        + (f"<ul>{facts}</ul>" if facts else "")
        + "<small>Drag to turn, wheel to zoom, shift-drag to move.</small></div>"
    )


def dressed(viewer_html: str, scene: Scene, parts: list[Part], title: str, told: dict[str, Any]) -> str:
    """The viewer's page with our title, cards and script in it."""
    viewer_html = viewer_html.replace(DARKENED, CLEAR)
    start, end = viewer_html.index("<title>"), viewer_html.index("</title>")
    page = viewer_html[:start] + f"<title>{escape(title)}" + viewer_html[end:]
    head, body, rest = page.partition("<body>")
    here = Path(__file__)
    style, script = (here.with_name(f"scene_page.{suffix}").read_text(encoding="utf-8") for suffix in ("css", "js"))
    # a text of ours must not end the element that holds it
    data = json.dumps(told, allow_nan=False).replace("<", "\\u003c")
    last = len(scene.moments) - 1
    return (
        f"{head}<style>{style}</style>{body}"
        # the viewer empties the element it draws in: with one of its own, the cards stay
        '<div class="content"></div>'
        f"{_legend(scene, parts, title)}"
        '<div class="card" id="seen" hidden><img alt="what the camera saw at this moment">'
        "<small>the camera's picture</small></div>"
        '<div class="card" id="time"><div><button type="button" id="play">play</button>'
        f'<input type="range" id="slider" min="0" max="{last}" aria-label="moment"><output id="clock"></output></div>'
        '<div><span id="words"></span><label><input type="checkbox" id="everything"> contacts of all moments</label>'
        "</div></div>"
        '<div class="card" id="silent" hidden>'
        "This browser cannot draw in three dimensions: WebGL is missing or switched off.</div>"
        f'<script type="application/json" id="story">{data}</script><script>{script}</script>{rest}'
    )
