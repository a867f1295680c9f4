"""The window's own controls: a slider for time, keys for colours and contacts."""

from __future__ import annotations

import pyvista as pv

from viz.parts.part import INK
from viz.scene.colours import MODES, contact_scale

from .stage import Stage

_HELP = "c: colour by force, time, uncertainty    a: contacts of all instants, or up to this one    q: close"


class Controls:
    """What the viewer has chosen; `stage` follows."""

    def __init__(self, plotter: pv.Plotter, stage: Stage, mode: str) -> None:
        self.plotter, self.stage = plotter, stage
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
        """Draw what is chosen and say it in words."""
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
        self.plotter.add_scalar_bar(
            self._bar,
            mapper=mapper,
            color=INK,
            n_labels=3,
            fmt="%.4g",
            width=0.3,
            height=0.07,
            position_x=0.67,
            position_y=0.9,
            title_font_size=16,
            label_font_size=14,
        )


def add_controls(plotter: pv.Plotter, stage: Stage, mode: str) -> Controls:
    """Put slider, keys and legend into the window."""
    controls = Controls(plotter, stage, mode)
    instants = stage.scene.instants
    if len(instants) > 1:
        plotter.add_slider_widget(
            controls.go,
            (0, len(instants) - 1),
            value=instants.main,
            title="instant",
            pointa=(0.30, 0.07),
            pointb=(0.95, 0.07),
            color=INK,
            fmt="%.0f",
            style="modern",
            slider_width=0.02,
            tube_width=0.006,
            title_height=0.018,
        )
    plotter.add_key_event("c", controls.next_mode)
    plotter.add_key_event("a", controls.toggle_everything)
    labels = {part.name: [f" {part.label}", part.colour] for part in stage.parts if part.contact is None}
    plotter.add_legend(
        list(labels.values()),
        face="rectangle",
        bcolor=None,
        loc="lower left",
        size=(0.27, 0.025 * len(labels)),
        font_family="arial",
    )
    controls.refresh()
    return controls
