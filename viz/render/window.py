"""An interactive window with the scene: a slider for time, keys for colours and contacts."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyvista as pv

from viz.parts.assemble import all_parts
from viz.scene.layout import INK
from viz.scene.readable import MODES, contact_scale
from viz.scene.scene import Scene

from .probe import require_opengl
from .stage import Stage, quiet


@dataclass(frozen=True)
class _WindowSettings:
    """Size and colours of the window; colours are RGB."""

    size: tuple[int, int] = (1400, 1000)  # width and height, px, where the screen is large enough
    share: float = 0.85  # of the screen, that the window covers at most
    near_px: int = 18  # distance from a contact's ball at which a click takes it
    line: tuple[int, int, int] = (34, 211, 238)  # of the fitted antenna in the camera's picture
    contact: tuple[int, int, int] = (250, 204, 21)  # of the contact in it


_WINDOW = _WindowSettings()


def show(scene: Scene, *, mode: str = "force") -> bool:
    """Open a window and wait until it is closed; False where none opens. Raises VbaaError."""
    require_opengl()
    with quiet():
        stage = Stage(scene, all_parts(scene), mode, _WINDOW.size, off_screen=False)
        stage.plotter.window_size = list(_fitting(stage.plotter.render_window.GetScreenSize()))
    # VTK turns to drawing unseen where no window opens
    if stage.plotter.render_window.GetOffScreenRendering():
        stage.plotter.close()
        return False
    _Controls(stage, mode).add_to_window()
    stage.look_at_all()
    stage.plotter.show()
    return True


def _fitting(screen: tuple[int, int]) -> tuple[int, int]:
    """The window's width and height on a screen of (width, height); the default where that is unknown."""
    most = [
        int(_WINDOW.share * size) if size > 0 else wanted for size, wanted in zip(screen, _WINDOW.size, strict=True)
    ]
    return min(_WINDOW.size[0], most[0]), min(_WINDOW.size[1], most[1])


class _Controls:
    """State of the window's slider and keys, applied to `stage`."""

    def __init__(self, stage: Stage, mode: str) -> None:
        self.stage, self.plotter = stage, stage.plotter
        self.mode, self.instant, self.everything = mode, stage.scene.instants.main, True
        self.close, self._pressed = False, (0, 0)
        self._bar: str | None = None
        self._slider: Any = None
        self._inset: Any = None
        self.contact: int | None = None
        self.measured_from: int | None = None

    def pick(self, contact: int) -> None:
        """Show a contact: its numbers, its instant, a mark on it, and its distance from the reference contact."""
        scene = self.stage.scene
        self.contact = contact % len(scene.contacts.points_m)
        self.instant = int(np.abs(scene.instants.row - scene.contacts.row[self.contact]).argmin())
        self.refresh()

    def contact_at(self, x: float, y: float) -> int | None:
        """The contact with its sphere at a pixel, counted from the lower left; else the nearest one."""
        scene, camera, size = self.stage.scene, self.plotter.camera, np.array(self.plotter.render_window.GetSize())
        view = pv.array_from_vtkmatrix(camera.GetModelViewTransformMatrix())
        projection = pv.array_from_vtkmatrix(camera.GetProjectionTransformMatrix(size[0] / size[1], -1, 1))

        def pixels(seen: np.ndarray) -> np.ndarray:
            drawn = seen @ projection[:, :3].T + projection[:, 3]
            return (1 + drawn[:, :2] / drawn[:, 3:]) * size / 2

        seen = scene.contacts.points_m @ view[:3, :3].T + view[:3, 3]
        places = pixels(seen)
        away = np.linalg.norm(places - [x, y], axis=1)
        if not self.everything:
            away[scene.contacts.row > scene.instants.row[self.instant]] = np.inf
        part = away / (pixels(seen + np.array([scene.ball_m, 0, 0])) - places)[:, 0]
        if (part < 1).any():
            depth = -seen[:, 2] - scene.ball_m * np.sqrt(np.maximum(1 - part**2, 0))
            return int(np.where(part < 1, depth, np.inf).argmin())
        return int(away.argmin()) if away.min() < _WINDOW.near_px else None

    def _click(self, _: object, event: str) -> None:
        """Pick the contact at the click, unless the mouse turned the scene between press and release."""
        place = self.plotter.iren.get_event_position()
        if event == "LeftButtonPressEvent":
            self._pressed = place
        elif np.hypot(*np.subtract(self._pressed, place)) < 4 and (contact := self.contact_at(*place)) is not None:
            self.pick(contact)

    def step(self, by: int) -> None:
        """Go to the next contact, or to the previous one."""
        self.pick(by + (-by if self.contact is None else self.contact))

    def measure(self) -> None:
        """Measure distances from the picked contact, or end that."""
        self.measured_from = self.contact if self.measured_from is None else None
        self.refresh()

    def save(self) -> None:
        """Save the picture into the current folder, under a new name."""
        names = (Path(f"scene{number:02d}.png") for number in count(1))
        self.plotter.screenshot(str(next(name for name in names if not name.exists())))

    def _numbers(self) -> str:
        """The words about the chosen contact and, if two are marked, the way between them."""
        contacts = self.stage.scene.contacts
        if self.contact is None:
            return ""
        words = contacts.words[self.contact]
        if self.measured_from is None:
            return words
        between = contacts.points_m[self.contact] - contacts.points_m[self.measured_from]
        length = float(np.linalg.norm(between))
        along = between / (length or 1.0)
        both = contacts.covariance_m2[self.contact] + contacts.covariance_m2[self.measured_from]
        std = np.sqrt(max(float(along @ both @ along), 0.0))
        spread = f" ± {1e3 * std:.2g}" if std > 0 else ""
        return f"{words}\n{1e3 * length:.2f}{spread} mm from {contacts.words[self.measured_from].partition(',')[0]}"

    def _mark(self) -> None:
        """Draw the marks of the chosen contacts, and the line between two."""
        scene = self.stage.scene
        chosen = [index for index in (self.measured_from, self.contact) if index is not None]
        points = scene.contacts.points_m[chosen]
        self.plotter.remove_actor(["marks", "measured"], render=False)
        look = {"color": INK, "reset_camera": False, "render": False, "pickable": False}
        if chosen:
            balls = {"point_size": 16, "render_points_as_spheres": True}
            self.plotter.add_mesh(pv.PolyData(points), name="marks", **balls, **look)
        if len(chosen) == 2:
            self.plotter.add_mesh(pv.MultipleLines(points), name="measured", line_width=3, **look)

    def look_closer(self) -> None:
        """Switch between a close-up of the contacts and the whole rig."""
        self.close = not self.close
        if self.close:
            self.stage.look_at_contacts(parallel=False)
        else:
            self.stage.look_at_all()
        self.plotter.render()

    def seen(self) -> np.ndarray | None:
        """(H, W, 3) uint8 camera picture of this instant, with the fitted antenna and the contact drawn over it."""
        scene = self.stage.scene
        picture = scene.pictures[self.instant] if scene.pictures else None
        if picture is None or scene.rig is None:
            return None
        over, size = picture.copy(), picture.shape[1::-1]
        places = scene.rig.seen[self.instant] * size
        line, contact = places[:-1][np.isfinite(places[:-1]).all(axis=1)], places[-1]
        cv2.polylines(over, [np.round(16 * line).astype(np.int32)], False, _WINDOW.line, 2, cv2.LINE_AA, shift=4)
        if np.isfinite(contact).all():
            cv2.circle(
                over, np.round(16 * contact).astype(int).tolist(), 16 * 5, _WINDOW.contact, -1, cv2.LINE_AA, shift=4
            )
        return over

    def go(self, instant: float) -> None:
        """Show the instant nearest to the slider's value."""
        self.instant = round(instant)
        self.refresh()

    def next_mode(self) -> None:
        """Colour by the next one of `MODES`."""
        self.mode = MODES[(MODES.index(self.mode) + 1) % len(MODES)]
        self.stage.paint(self.mode)
        self.refresh()

    def toggle_everything(self) -> None:
        """Switch between all contacts and those up to the instant."""
        self.everything = not self.everything
        self.refresh()

    def refresh(self) -> None:
        """Redraw picture, text and colour bar."""
        instants, now = self.stage.scene.instants, self.instant
        self.stage.show(now, everything=self.everything)
        help_words = (
            "c: colour by force, time, uncertainty    a: contacts of all times, or up to this one    q: close\n"
            "left click or n, b: a contact's numbers    m: measure from it    z: close up, or all    "
            "g: save the picture"
        )
        words = (
            f"{instants.time_s[now]:.2f} s, frame {instants.frame[now]}: {instants.words[now]}\n"
            f"contacts and forces coloured by {self.mode}\n{help_words}"
        )
        for text_now, at, font, name in (
            (words, "upper_left", 10, "words"),
            (self._numbers(), "left_edge", 9, "numbers"),
        ):
            actor = self.plotter.add_text(text_now, position=at, font_size=font, color=INK, name=name, render=False)
            actor.prop.background_color, actor.prop.background_opacity = "white", 0.8
        self._mark()
        self._follow()
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

    def _follow(self) -> None:
        """Update slider and camera picture to this instant."""
        if self._slider is not None:
            self._slider.GetRepresentation().SetValue(self.instant)
        if self._inset is None:
            return
        seen, representation = self.seen(), self._inset.GetRepresentation()
        representation.SetVisibility(seen is not None)
        if seen is not None:
            image = pv.ImageData(dimensions=(*seen.shape[1::-1], 1))
            image.point_data["rgb"] = seen[::-1].reshape(-1, 3)
            representation.SetImage(image)

    def add_to_window(self) -> None:
        """Add slider, keys, legend and the camera's picture."""
        instants = self.stage.scene.instants
        if len(instants) > 1:
            ends, place = (0, len(instants) - 1), {"pointa": (0.30, 0.07), "pointb": (0.95, 0.07)}
            look = {"style": "modern", "slider_width": 0.02, "tube_width": 0.006, "title_height": 0.018}
            words = {"title": "time step", "fmt": "%.0f", "color": INK}
            self._slider = self.plotter.add_slider_widget(self.go, ends, value=instants.main, **words, **place, **look)
        self.plotter.add_key_event("c", self.next_mode)
        self.plotter.add_key_event("a", self.toggle_everything)
        self.plotter.add_key_event("n", lambda: self.step(1))
        self.plotter.add_key_event("b", lambda: self.step(-1))
        self.plotter.add_key_event("m", self.measure)
        self.plotter.add_key_event("g", self.save)
        self.plotter.add_key_event("z", self.look_closer)
        for event in ("LeftButtonPressEvent", "LeftButtonReleaseEvent"):
            self.plotter.iren.style.AddObserver(event, self._click)
        if self.stage.scene.pictures:
            self._inset = self.plotter.add_logo_widget(
                pv.ImageData(dimensions=(2, 2, 1)), position=(0.76, 0.6), size=(0.22, 0.27)
            )
            self._inset.ProcessEventsOff()
        rows = list({p.name: [f" {p.label}", p.colour] for p in self.stage.parts if p.contact is None}.values())
        look = {
            "face": "rectangle",
            "bcolor": "white",
            "background_opacity": 0.8,
            "loc": "lower left",
            "font_family": "arial",
        }
        self.plotter.add_legend(rows, size=(0.27, 0.025 * len(rows)), **look)
        self.refresh()
