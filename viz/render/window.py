"""A window with the scene: a slider for time, keys for colours and contacts."""

from __future__ import annotations

import pyvista as pv

from viz.parts.assemble import all_parts
from viz.parts.part import INK
from viz.scene.readable import MODES, contact_scale
from viz.scene.scene import Scene

from .probe import require_opengl
from .stage import Stage, quiet

_HELP = "c: colour by force, time, uncertainty    a: contacts of all instants, or up to this one    q: close"


def show(scene: Scene, *, mode: str = "force") -> bool:
    """Open a window and wait until it is closed; False where none opens. Raises OpenGLError."""
    require_opengl()
    with quiet():
        stage = Stage(scene, all_parts(scene), mode, (1400, 1000), off_screen=False)
    # VTK turns to drawing unseen where no window opens
    if stage.plotter.render_window.GetOffScreenRendering():
        stage.plotter.close()
        return False
    Controls(stage, mode).add_to_window()
    stage.look_at_all()
    stage.plotter.show()
    return True


class Controls:
    """State of the window's slider and keys, applied to `stage`."""

    def __init__(self, stage: Stage, mode: str) -> None:
        self.stage, self.plotter = stage, stage.plotter
        self.mode, self.instant, self.everything = mode, stage.scene.instants.main, True
        self._bar: str | None = None

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
        rows = list({p.name: [f" {p.label}", p.colour] for p in self.stage.parts if p.contact is None}.values())
        look = {"face": "rectangle", "bcolor": None, "loc": "lower left", "font_family": "arial"}
        self.plotter.add_legend(rows, size=(0.27, 0.025 * len(rows)), **look)
        self.refresh()
