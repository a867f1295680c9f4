"""The HTML around the interactive scene: the viewer draws no text, so title and legend stand beside it."""

from __future__ import annotations

from html import escape

import pyvista as pv

from . import actors
from .scene import Scene

_STYLE = """
<style>
  body { font-family: system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; }
  .content { position: fixed; inset: 0; }
  #vbaa { position: fixed; top: 16px; right: 16px; z-index: 10; max-width: 21rem; padding: 14px 18px;
          border-radius: 10px; background: rgba(255, 255, 255, .88); color: #1f2937;
          box-shadow: 0 1px 8px rgba(31, 41, 55, .18); font-size: 14px; line-height: 1.5; pointer-events: none; }
  #vbaa h1 { font-size: 16px; margin: 0 0 6px; }
  #vbaa i { display: inline-block; width: 14px; height: 14px; border-radius: 3px; margin-right: 8px;
            vertical-align: -2px; border: 1px solid rgba(0, 0, 0, .15); }
  #vbaa .bar { height: 12px; border-radius: 3px; margin: 8px 0 2px; }
  #vbaa .ends { display: flex; justify-content: space-between; font-variant-numeric: tabular-nums; }
  #vbaa small { color: #6b7280; }
</style>
"""


def legend(scene: Scene, title: str) -> str:
    """The legend as an HTML fragment: parts by colour, and the force scale with its ends."""
    rows = "".join(
        f'<div><i style="background:{actors.LOOK[part][0]}"></i>{escape(actors.LOOK[part][1])}</div>'
        for part in actors.parts(scene)
    )
    low, high = actors.force_range_mN(scene)
    colours = ", ".join(pv.Color(rgba).hex_rgb for rgba in pv.LookupTable(actors.FORCE_MAP, n_values=9).values)
    return (
        f'<div id="vbaa"><h1>{escape(title)}</h1>{rows}'
        f'<div class="bar" style="background:linear-gradient(to right, {colours})"></div>'
        f'<div class="ends"><span>{low:g} mN</span><span>force on the antenna</span><span>{high:g} mN</span></div>'
        f"<small>{len(scene.contacts.points_m)} contacts. "
        "Drag to turn, wheel to zoom, shift-drag to move.</small></div>"
    )


def dressed(viewer_html: str, scene: Scene, title: str) -> str:
    """The viewer's page with our title and legend in it."""
    start, end = viewer_html.index("<title>"), viewer_html.index("</title>")
    page = viewer_html[:start] + f"<title>{escape(title)}" + viewer_html[end:]
    head, body, rest = page.partition("<body>")
    # the viewer empties the element it draws in: with one of its own, the legend stays
    return f'{head}{_STYLE}{body}{legend(scene, title)}<div class="content"></div>{rest}'
