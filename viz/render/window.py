"""A window with the scene: a slider for time, keys for colours and contacts."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
from pathlib import Path

import numpy as np
import pyvista as pv

from viz.parts.assemble import all_parts
from viz.parts.part import INK
from viz.scene.readable import MODES, contact_scale
from viz.scene.scene import Scene

from .probe import require_opengl
from .stage import Stage, quiet

_HELP = (
    "c: colour by force, time, uncertainty    a: contacts of all instants, or up to this one    q: close\n"
    "left click or n, b: a contact's numbers    m: measure from it    g: save the picture"
)
_SIZE, _SHARE = (1400, 1000), 0.85
"""Of the window; at most this share of the screen."""


def show(scene: Scene, *, mode: str = "force") -> bool:
    """Open a window and wait until it is closed; False where none opens. Raises OpenGLError."""
    require_opengl()
    with quiet():
        stage = Stage(scene, all_parts(scene), mode, _SIZE, off_screen=False)
        stage.plotter.window_size = list(fitting(stage.plotter.render_window.GetScreenSize()))
    # VTK turns to drawing unseen where no window opens
    if stage.plotter.render_window.GetOffScreenRendering():
        stage.plotter.close()
        return False
    Controls(stage, mode).add_to_window()
    stage.look_at_all()
    stage.plotter.show()
    return True


def fitting(screen: tuple[int, int]) -> tuple[int, int]:
    """The window's width and height on a screen of (width, height); as usual where that is unknown."""
    most = [int(_SHARE * size) if size > 0 else wanted for size, wanted in zip(screen, _SIZE, strict=True)]
    return min(_SIZE[0], most[0]), min(_SIZE[1], most[1])


class Controls:
    """State of the window's slider and keys, applied to `stage`."""

    def __init__(self, stage: Stage, mode: str) -> None:
        self.stage, self.plotter = stage, stage.plotter
        self.mode, self.instant, self.everything = mode, stage.scene.instants.main, True
        self._bar: str | None = None
        self.contact: int | None = None
        self.measured_from: int | None = None

    def pick(self, contact: int) -> None:
        """Show a contact: its numbers, its instant, a mark on it, and how far it is from the one measured from."""
        scene = self.stage.scene
        self.contact = contact % len(scene.contacts.points_m)
        self.instant = int(np.abs(scene.instants.row - scene.contacts.row[self.contact]).argmin())
        self.refresh()

    def pick_near(self, point: Sequence[float]) -> None:
        """The contact nearest to a point (3,) m that was clicked, if it is as near as its mark is large."""
        scene = self.stage.scene
        away = np.linalg.norm(scene.contacts.points_m - np.asarray(point), axis=1)
        if away.min() < 0.06 * scene.bounding_ball_m[1]:
            self.pick(int(away.argmin()))

    def step(self, by: int) -> None:
        """The next contact, or the one before."""
        self.pick(by + (-by if self.contact is None else self.contact))

    def measure(self) -> None:
        """Measure from the contact that is picked, or end that."""
        self.measured_from = self.contact if self.measured_from is None else None
        self.refresh()

    def save(self) -> None:
        """Write the picture into the folder from which the window was opened, under a name that is free."""
        names = (Path(f"scene{number:02d}.png") for number in count(1))
        self.plotter.screenshot(str(next(name for name in names if not name.exists())))

    def _numbers(self) -> str:
        contacts = self.stage.scene.contacts
        if self.contact is None:
            return ""
        words = contacts.words[self.contact]
        if self.measured_from is None:
            return words
        length_mm = 1e3 * np.linalg.norm(contacts.points_m[self.contact] - contacts.points_m[self.measured_from])
        return f"{words}\n{length_mm:.2f} mm from {contacts.words[self.measured_from].partition(',')[0]}"

    def _mark(self) -> None:
        scene = self.stage.scene
        chosen = [index for index in (self.measured_from, self.contact) if index is not None]
        points = scene.contacts.points_m[chosen]
        self.plotter.remove_actor("marks", render=False)
        if chosen:
            mesh = pv.MultipleLines(points) if len(chosen) == 2 else pv.PolyData(points)
            look = {"color": INK, "point_size": 16, "line_width": 3, "render_points_as_spheres": True}
            self.plotter.add_mesh(mesh, name="marks", reset_camera=False, render=False, pickable=False, **look)

    def go(self, instant: float) -> None:
        """Show the instant nearest to the slider's value."""
        self.instant = round(instant)
        self.refresh()

    def next_mode(self) -> None:
        """Colour by the next of `MODES`."""
        self.mode = MODES[(MODES.index(self.mode) + 1) % len(MODES)]
        self.stage.paint(self.mode)
        self.refresh()

    def toggle_everything(self) -> None:
        """All contacts, or those up to the instant."""
        self.everything = not self.everything
        self.refresh()

    def refresh(self) -> None:
        """Update picture, text and colour bar."""
        instants, now = self.stage.scene.instants, self.instant
        self.stage.show(now, everything=self.everything)
        words = (
            f"{instants.time_s[now]:.2f} s, frame {instants.frame[now]}: {instants.words[now]}\n"
            f"contacts and forces coloured by {self.mode}\n{_HELP}"
        )
        self.plotter.add_text(words, position="upper_left", font_size=10, color=INK, name="words")
        self.plotter.add_text(self._numbers(), position="left_edge", font_size=9, color=INK, name="numbers")
        self._mark()
        scale = contact_scale(self.stage.scene, self.mode)
        if self._bar is not None:
            self.plotter.remove_scalar_bar(self._bar)
        self._bar = f"{scale.ends[1]}\n"
        # the contacts bring their own colours: the bar has a mapper of its own
        mapper = pv.DataSetMapper()
        mapper.lookup_table = pv.LookupTable(scale.colormap, scalar_range=(scale.ticks[0], scale.ticks[-1]))
        place = {"width": 0.3, "height": 0.07, "position_x": 0.67, "position_y": 0.9}
        text = {"n_labels": 3, "fmt": "%.4g", "title_font_size": 16, "label_font_size": 14}
        self.plotter.add_scalar_bar(self._bar, mapper=mapper, color=INK, **place, **text)

    def add_to_window(self) -> None:
        """Slider, keys and legend."""
        instants = self.stage.scene.instants
        if len(instants) > 1:
            ends, place = (0, len(instants) - 1), {"pointa": (0.30, 0.07), "pointb": (0.95, 0.07)}
            look = {"style": "modern", "slider_width": 0.02, "tube_width": 0.006, "title_height": 0.018}
            words = {"title": "instant", "fmt": "%.0f", "color": INK}
            self.plotter.add_slider_widget(self.go, ends, value=instants.main, **words, **place, **look)
        self.plotter.add_key_event("c", self.next_mode)
        self.plotter.add_key_event("a", self.toggle_everything)
        self.plotter.add_key_event("n", lambda: self.step(1))
        self.plotter.add_key_event("b", lambda: self.step(-1))
        self.plotter.add_key_event("m", self.measure)
        self.plotter.add_key_event("g", self.save)
        self.plotter.track_click_position(self.pick_near, side="left")
        rows = list({p.name: [f" {p.label}", p.colour] for p in self.stage.parts if p.contact is None}.values())
        look = {"face": "rectangle", "bcolor": None, "loc": "lower left", "font_family": "arial"}
        self.plotter.add_legend(rows, size=(0.27, 0.025 * len(rows)), **look)
        self.refresh()
