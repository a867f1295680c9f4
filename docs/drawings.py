"""The drawings of the documentation and of the wizard's page, as SVG: `python docs/drawings.py` writes them.

`tests/test_docs.py` checks that the files there are what this module draws.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

FOLDER = Path(__file__).parent / "images" / "drawings"
OF_STEPS = Path(__file__).parents[1] / "vbaa_calib" / "wizard" / "static"
INK, GREY, BLUE, ORANGE, GREEN, PALE = "#1f2937", "#64748b", "#0b6ea8", "#b45309", "#2c7a4b", "#e8eef4"
Point = tuple[float, float]


@dataclass
class Sheet:
    """A drawing on white, so that it reads on a dark page, too. Lengths in px; y points down."""

    width: int
    height: int
    title: str
    shapes: list[str] = field(default_factory=list)

    def line(self, *points: Point, colour: str = INK, width: float = 2, arrow: bool = False, dash: str = "") -> None:
        """A path through points, with an arrow's head at its end."""
        path = "M" + "L".join(f"{x:g} {y:g}" for x, y in points)
        self.path(path, colour, width, arrow=arrow, dash=dash)

    def path(self, path: str, colour: str = INK, width: float = 2, *, arrow: bool = False, dash: str = "") -> None:
        """Any SVG path."""
        more = f' marker-end="url(#{colour[1:]})"' if arrow else ""
        more += f' stroke-dasharray="{dash}"' if dash else ""
        self.shapes.append(f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="{width:g}"{more}/>')

    def box(self, x: float, y: float, width: float, height: float, fill: str = PALE, turn: float = 0) -> None:
        """A rectangle, turned about its middle by degrees."""
        about = f' transform="rotate({turn:g} {x + width / 2:g} {y + height / 2:g})"' if turn else ""
        self.shapes.append(
            f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="3" fill="{fill}" '
            f'stroke="{INK}"{about}/>'
        )

    def dot(self, x: float, y: float, colour: str = ORANGE, radius: float = 5) -> None:
        """A filled circle."""
        self.shapes.append(f'<circle cx="{x:g}" cy="{y:g}" r="{radius:g}" fill="{colour}"/>')

    def text(self, x: float, y: float, words: str, colour: str = INK, anchor: str = "start", size: int = 15) -> None:
        """One line of words."""
        self.shapes.append(
            f'<text x="{x:g}" y="{y:g}" fill="{colour}" text-anchor="{anchor}" font-size="{size}">'
            f"{escape(words)}</text>"
        )

    def measure(self, start: Point, end: Point, words: str, at: Point) -> None:
        """A dimension with arrows at both ends."""
        middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
        self.line(middle, start, colour=GREY, width=1.2, arrow=True)
        self.line(middle, end, colour=GREY, width=1.2, arrow=True)
        self.text(*at, words, GREY)

    def board(self, x: float, y: float, columns: int, rows: int, size: float) -> None:
        """A chequered board."""
        self.box(x, y, columns * size, rows * size, "#ffffff")
        squares = "".join(
            f"M{x + c * size:g} {y + r * size:g}h{size:g}v{size:g}h-{size:g}z"
            for r in range(rows)
            for c in range(columns)
            if (r + c) % 2 == 0
        )
        self.shapes.append(f'<path d="{squares}" fill="{INK}"/>')

    def svg(self) -> str:
        """The file's text."""
        heads = "".join(
            f'<marker id="{colour[1:]}" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7" '
            f'orient="auto"><path d="M0 0L10 5L0 10z" fill="{colour}"/></marker>'
            for colour in (INK, GREY, BLUE, ORANGE, GREEN)
        )
        body = "\n".join(self.shapes)
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width} {self.height}" width="{self.width}" '
            f'font-family="DejaVu Sans, Verdana, sans-serif" role="img" aria-label="{escape(self.title)}">\n'
            f"<title>{escape(self.title)}</title><defs>{heads}</defs>\n"
            f'<rect width="{self.width}" height="{self.height}" rx="8" fill="#ffffff"/>\n{body}\n</svg>\n'
        )


def base(sheet: Sheet, x: float, y: float) -> None:
    """The plate on the joints, the moment sensor and the clamp, whose end is (x, y)."""
    sheet.box(x - 120, y + 22, 130, 16)
    sheet.box(x - 95, y - 12, 42, 34, "#dcebdd")
    sheet.box(x - 50, y - 11, 50, 22, "#cbd5e1")


def camera(sheet: Sheet, x: float, y: float, turn: float) -> None:
    """A camera that looks along its lens; unturned, downwards."""
    sheet.box(x - 26, y - 20, 52, 40, "#334155", turn)
    sheet.shapes.append(
        f'<rect x="{x - 12:g}" y="{y + 18:g}" width="24" height="16" fill="#64748b" '
        f'transform="rotate({turn:g} {x:g} {y:g})"/>'
    )


def idea() -> Sheet:
    """What is measured, and what is computed from it."""
    sheet = Sheet(820, 360, "The antenna, its contact, and what is measured")
    base(sheet, 150, 230)
    sheet.line((150, 230), (700, 230), colour=GREY, width=1.5, dash="6 5")
    sheet.path("M150 230C300 230 390 214 470 182L690 84", BLUE, 4)
    sheet.dot(470, 182)
    sheet.line((470, 262), (470, 192), colour=ORANGE, width=3, arrow=True)
    sheet.text(480, 254, "force f: how hard", ORANGE)
    sheet.text(486, 196, "contact point", ORANGE)
    sheet.measure((152, 206), (456, 160), "distance l along the antenna: where", (150, 160))
    sheet.text(704, 82, "tip", BLUE)
    sheet.text(540, 222, "free (undeformed) antenna", GREY, size=13)
    camera(sheet, 330, 44, -4)
    for x, y in ((170, 222), (470, 178), (686, 82)):
        sheet.line((332, 82), (x, y), colour=GREY, width=1, dash="2 5")
    sheet.text(372, 50, "camera: sees the bent shape")
    sheet.text(20, 296, "moment sensor: the bending", GREEN)
    sheet.text(20, 314, "moment at the clamp", GREEN)
    sheet.line((70, 280), (76, 254), colour=GREEN, arrow=True)
    sheet.text(268, 304, "plane C: a plane through the free antenna, on which pixels become millimetres", GREY, size=13)
    sheet.text(
        20,
        346,
        "Camera, sensor and antenna are fixed to one plate; two joints (pan, tilt) turn the plate.",
        INK,
        size=14,
    )
    return sheet


def rig() -> Sheet:
    """The rig from the side, with the sizes of the demo's."""
    sheet = Sheet(820, 470, "The rig from the side, with sizes")
    base(sheet, 190, 330)
    sheet.line((190, 330), (640, 330), colour=BLUE, width=4)
    sheet.box(118, 80, 16, 272, PALE)
    camera(sheet, 180, 100, -38)
    sheet.line((202, 128), (196, 318), colour=GREY, width=1, dash="2 5")
    sheet.line((204, 126), (690, 336), colour=GREY, width=1, dash="2 5")
    sheet.measure((228, 148), (402, 322), "200 to 400 mm", (214, 264))
    sheet.measure((190, 382), (640, 382), "antenna: 150 to 300 mm long, 0.5 to 1 mm thick", (230, 402))
    sheet.text(222, 88, "camera, lens locked with tape or a screw")
    sheet.text(16, 222, "stiff post", INK)
    sheet.text(580, 240, "leave a tenth of the", GREY, size=13)
    sheet.text(580, 256, "picture free beyond the tip", GREY, size=13)
    sheet.line((170, 420), (164, 345), colour=INK, width=1.2, arrow=True)
    sheet.text(176, 434, "clamp: grips at least 10 diameters of wire")
    sheet.line((70, 396), (108, 340), colour=GREEN, width=1.2, arrow=True)
    sheet.text(16, 412, "moment sensor", GREEN)
    sheet.text(16, 460, "One stiff plate carries all three. It may turn on two joints, pan and tilt.", INK, size=14)
    return sheet


def jig() -> Sheet:
    """The board in its jig, seen by the camera, with what is measured of it."""
    sheet = Sheet(820, 400, "The board in its jig, from above: what to measure")
    sheet.box(40, 150, 130, 100)
    sheet.box(120, 186, 50, 28, "#cbd5e1")
    sheet.line((170, 200), (700, 200), colour=BLUE, width=4)
    sheet.board(290, 60, 9, 7, 40)
    sheet.box(165, 318, 130, 22, "#f1e3cf")
    sheet.box(150, 236, 30, 104, "#f1e3cf")
    sheet.dot(170, 200)
    sheet.text(184, 220, "clamp (0, 0, 0)", ORANGE, size=13)
    sheet.dot(290, 60)
    sheet.text(200, 44, "first corner of the board's outline", ORANGE)
    sheet.measure((170, 130), (290, 130), "x", (222, 122))
    sheet.measure((272, 60), (272, 200), "y", (254, 170))
    sheet.text(24, 366, "jig: two dowel pins or a milled step, so that the board always goes back to the same place")
    sheet.text(
        24, 386, "z: how far the board's back is above (+) or below (−) the antenna's axis; then its thickness", GREY
    )
    sheet.text(664, 190, "antenna", BLUE)
    return sheet


def bench() -> Sheet:
    """Which way the axes of antenna and board point, from the camera and from the side, and what is positive."""
    sheet = Sheet(820, 560, "Axes and signs on your bench")

    def tripod(x: float, y: float, names: str, colour: str, down: bool = False) -> None:
        """x to the right, the second axis up or down, the third towards who looks (a dot) or away (a cross)."""
        sheet.line((x, y), (x + 58, y), colour=colour, width=3, arrow=True)
        sheet.line((x, y), (x, y + (58 if down else -58)), colour=colour, width=3, arrow=True)
        sheet.text(x + 50, y - 9, names[0], colour)
        sheet.text(x + 8, y + (58 if down else -48), names[1], colour)
        sheet.shapes.append(f'<circle cx="{x:g}" cy="{y:g}" r="8" fill="#ffffff" stroke="{colour}" stroke-width="2"/>')
        if names[3:]:
            sheet.dot(x, y, colour, 3)
        else:
            sheet.line((x - 5, y - 5), (x + 5, y + 5), colour=colour)
            sheet.line((x - 5, y + 5), (x + 5, y - 5), colour=colour)
        sheet.text(x - 14, y + (-10 if down else 22), names[2], colour, "end")

    sheet.text(20, 26, "From the camera, the clamp to the left", INK, size=16)
    sheet.box(20, 150, 110, 80)
    sheet.box(90, 176, 50, 28, "#cbd5e1")
    sheet.line((140, 190), (700, 190), colour=BLUE, width=4)
    sheet.board(300, 70, 8, 6, 36)
    tripod(140, 190, "xyz.", ORANGE)
    tripod(300, 70, "xyz", GREEN, down=True)
    sheet.text(210, 58, "board", GREEN, "end")
    sheet.text(20, 262, "antenna: z towards the camera (dot)", ORANGE, size=14)
    sheet.text(600, 56, "origin: top left corner,", GREEN, size=14)
    sheet.text(600, 74, "the print upright; z away", GREEN, size=14)
    sheet.text(600, 92, "from the camera (cross)", GREEN, size=14)
    sheet.text(700, 122, "pan +: tip to +y", INK, "middle")
    sheet.line((700, 182), (700, 130), colour=INK, arrow=True)
    sheet.text(20, 324, "From the side", INK, size=16)
    base(sheet, 190, 440)
    sheet.line((190, 440), (700, 440), colour=BLUE, width=4)
    tripod(190, 440, "xzy", ORANGE)
    camera(sheet, 420, 340, 0)
    sheet.box(300, 490, 288, 14, "#ffffff")
    sheet.line((300, 490), (588, 490), colour=INK, width=4)
    sheet.text(596, 494, "printed face", INK, size=14)
    sheet.text(596, 512, "back: z is measured to it", GREY, size=14)
    sheet.measure((282, 440), (282, 504), "z < 0", (236, 486))
    sheet.line((700, 432), (700, 380), colour=INK, arrow=True)
    sheet.text(684, 404, "tilt +: tip to +z", INK, "end")
    sheet.text(620, 462, "f_z > 0: pushed to +z", ORANGE)
    sheet.text(
        20,
        546,
        "The camera may stand anywhere that sees the antenna; the jig's answers say where z points.",
        GREY,
        size=14,
    )
    return sheet


def rulers() -> Sheet:
    """The printed sheet on something flat, and how its two rulers are read."""
    sheet = Sheet(820, 400, "The sheet, and its two rulers: measure both from end line to end line")
    sheet.box(200, 20, 420, 300, "#ffffff")
    sheet.board(258, 40, 9, 6, 38)
    for start, end, words, at in (
        ((250, 294), (600, 294), "x", (606, 300)),
        ((228, 40), (228, 268), "y", (210, 158)),
    ):
        sheet.line(start, end, colour=ORANGE, width=2)
        for x, y in (start, end):
            along = start[1] == end[1]
            sheet.line((x - 8 * (not along), y - 8 * along), (x + 8 * (not along), y + 8 * along), colour=ORANGE)
        sheet.text(*at, words, ORANGE)
    sheet.text(24, 160, "1  print at 100 %,", INK)
    sheet.text(24, 180, "not fitted", INK)
    sheet.text(24, 215, "2  glue it on", INK)
    sheet.text(24, 235, "glass or a plate", INK)
    sheet.text(200, 352, "3  measure both rulers from end line to end line, with a steel ruler or a caliper", ORANGE)
    sheet.text(200, 378, "A print 1 % too large makes every distance 1 % wrong, and EI with them.", GREY, size=13)
    return sheet


def poses() -> Sheet:
    """Where and how the board is held for the lens."""
    sheet = Sheet(
        820, 330, "The board for the lens: over the whole picture, near and far, tilted each time another way"
    )
    sheet.box(30, 30, 380, 230, "#f8fafc")
    sheet.text(30, 286, "the camera's picture: everywhere, its corners too", INK)
    for corners in (
        "M50 50L170 44L176 118L54 128z",
        "M270 40L392 52L386 128L276 110z",
        "M46 170L160 160L150 250L60 244z",
        "M280 176L396 166L398 250L268 240z",
        "M150 90L300 84L306 200L144 206z",
    ):
        sheet.path(corners, BLUE, 2.5)
    camera(sheet, 620, 50, 0)
    for x, y, turn in ((520, 160, -32), (620, 220, 0), (720, 160, 32)):
        sheet.box(x - 55, y - 5, 110, 10, "#ffffff", turn)
        sheet.line((620, 88), (x, y - 8), colour=GREY, width=1, dash="2 5")
    sheet.text(470, 286, "tilted by 30 to 45°, each time another way", INK)
    sheet.text(30, 314, "Hold it still for each picture: on a stand, or both elbows on the table.", GREY, size=13)
    return sheet


def light() -> Sheet:
    """Lamp, background and antenna, seen along the antenna."""
    sheet = Sheet(820, 330, "Light and background, seen along the antenna")
    camera(sheet, 330, 50, 0)
    sheet.dot(330, 196, BLUE, 8)
    sheet.text(350, 202, "antenna: painted matt white or black", BLUE)
    sheet.line((330, 88), (330, 184), colour=GREY, width=1, dash="2 5")
    sheet.box(130, 284, 420, 14, "#334155")
    sheet.text(150, 320, "plain, matt background of the other brightness, 50 mm or more behind it")
    sheet.box(40, 60, 26, 130, "#fff3c4", -25)
    for y in (90, 125, 160):
        sheet.line((92, y), (300, 150 + 0.35 * y), colour=ORANGE, width=1.2, arrow=True)
    sheet.text(16, 40, "large, diffuse lamp", ORANGE)
    sheet.text(16, 226, "constant brightness;", GREY)
    sheet.text(16, 244, "do not move it after calibrating", GREY)
    sheet.text(380, 46, "camera: short exposure;")
    sheet.text(380, 66, "fixed gain, focus and white balance")
    return sheet


def load() -> Sheet:
    """A known load on the antenna."""
    sheet = Sheet(820, 300, "A known load: a thread with a weight")
    base(sheet, 150, 110)
    sheet.line((150, 110), (690, 110), colour=GREY, width=1.2, dash="6 5")
    sheet.path("M150 110C300 110 420 118 520 142L690 190", BLUE, 4)
    sheet.line((520, 142), (520, 220), colour=INK, width=1.5)
    sheet.box(502, 220, 36, 36, "#cbd5e1")
    sheet.text(550, 244, "weight m, so f = m · 9.81 m/s²")
    sheet.measure((152, 84), (514, 112), "distance along the antenna, to 0.5 mm", (190, 66))
    sheet.line((690, 110), (690, 180), colour=GREY, width=1.2, arrow=True)
    sheet.text(560, 100, "bend it by 5° to 25°", GREY)
    sheet.text(24, 286, "Three weights at three or four distances; the thread hangs free and the antenna is at rest.")
    return sheet


def sign() -> Sheet:
    """A push along +z, the moment that is meant, and what a right-handed sensor says of it."""
    sheet = Sheet(820, 300, "The sign of the moment: a push towards +z at the distance l")
    base(sheet, 170, 190)
    sheet.path("M170 190C330 190 450 178 640 96", BLUE, 4)
    sheet.line((520, 246), (520, 162), colour=ORANGE, width=3, arrow=True)
    sheet.text(532, 240, "f_z > 0: the object pushes towards +z", ORANGE, size=14)
    sheet.measure((172, 206), (514, 206), "l", (340, 224))
    sheet.path("M214 214A46 46 0 0 0 196 148", GREEN, 3, arrow=True)
    sheet.text(226, 152, "moment + l·f_z: this is taken", GREEN)
    sheet.line((40, 110), (100, 110), arrow=True)
    sheet.text(106, 115, "x")
    sheet.line((40, 110), (40, 50), arrow=True)
    sheet.text(34, 42, "z")
    sheet.line((32, 118), (48, 102), width=1.5)
    sheet.line((32, 102), (48, 118), width=1.5)
    sheet.text(20, 136, "y, into the page", size=13)
    sheet.text(150, 54, "right-handed about y, the same moment is torque.y = −l·f_z: --moment-axis -y", INK)
    sheet.text(150, 78, "a sensor that states its own reaction says + l·f_z: --moment-axis y", INK)
    sheet.text(20, 286, "Try it: push towards +z; what is taken must rise.", INK, size=14)
    return sheet


def floors() -> Sheet:
    """The packages: data flows down, imports point up."""
    sheet = Sheet(820, 440, "Packages as floors: data flows down, imports point up")
    rows = (
        ("targets/", "boards: specification, sheets to print", "#e8eef4"),
        ("vbaa_calib/", "session, camera, antenna, detect, calibrate, check, simulate, streams, wizard", "#dcebdd"),
        ("estimator/", "solver, contact, table, object, recording, live, budget, paper", "#fdebd3"),
        ("viz/", "scene, figures, pages, reports, batch; the verbs that use all floors", "#f3e3f0"),
        ("benchmarks/", "speed against error; not installed, used by nothing", "#f1f5f9"),
    )
    for index, (name, words, colour) in enumerate(rows):
        y = 20 + 80 * index
        sheet.box(90, y, 640, 58, colour)
        sheet.text(108, y + 25, name, size=17)
        sheet.text(108, y + 46, words, GREY, size=13)
    sheet.line((50, 30), (50, 400), colour=BLUE, width=3, arrow=True)
    sheet.text(14, 424, "data", BLUE)
    sheet.line((770, 400), (770, 30), colour=ORANGE, width=3, arrow=True)
    sheet.text(806, 424, "imports", ORANGE, "end")
    return sheet


def circuit() -> Sheet:
    """From the strain gauges at the clamp to `vbaa live`."""
    sheet = Sheet(820, 330, "From the bridge to vbaa live")
    corners = [(130, 50), (210, 130), (130, 210), (50, 130)]
    for index, (start, end) in enumerate(zip(corners, [*corners[1:], corners[0]], strict=True)):
        middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
        sheet.line(start, end)
        sheet.box(middle[0] - 22, middle[1] - 8, 44, 16, "#ffffff", 45 if index % 2 == 0 else -45)
    for corner in corners:
        sheet.dot(*corner, INK, 3)
    sheet.text(130, 128, "four gauges", INK, "middle", 13)
    sheet.text(130, 144, "350 Ω", GREY, "middle", 13)
    sheet.text(20, 250, "two on either side of a thin web behind", GREY, size=13)
    sheet.text(20, 268, "the clamp, which bends about the antenna's y", GREY, size=13)
    sheet.box(330, 40, 150, 180)
    sheet.text(405, 118, "HX711", INK, "middle", 17)
    sheet.text(405, 140, "amplifier, 24 bit", GREY, "middle", 13)
    wires = (
        ("E+", 56, (130, 50), (130, 34), (300, 34), (300, 56)),
        ("A+", 112, (210, 130), (240, 130), (240, 112)),
        ("A−", 160, (50, 130), (24, 130), (24, 228), (270, 228), (270, 160)),
        ("E−", 204, (130, 210), (130, 218), (300, 218), (300, 204)),
    )
    for name, y, *way in wires:
        colour = BLUE if name[0] == "A" else ORANGE
        sheet.line(*way, (330, y), colour=colour)
        sheet.text(336, y + 5, name, colour, size=13)
    sheet.box(570, 40, 130, 180)
    sheet.text(645, 88, "Arduino,", INK, "middle")
    sheet.text(645, 136, "ESP32, Teensy", INK, "middle", 13)
    for pin, other, y in (("VCC", "5 / 3.3 V", 60), ("DT", "2", 112), ("SCK", "3", 152), ("GND", "GND", 204)):
        sheet.line((480, y), (570, y), colour=GREEN)
        sheet.text(474, y + 5, pin, GREEN, "end", 13)
        sheet.text(576, y + 5, other, GREEN, size=13)
    sheet.line((700, 130), (780, 130), colour=INK, arrow=True)
    sheet.text(706, 120, "USB: JSON", INK, size=13)
    sheet.text(706, 150, "vbaa live", BLUE, size=15)
    rate = "RATE of the HX711 to VCC: 80 readings a second, else 10. A shielded cable, as short as you can."
    sheet.text(20, 294, rate, size=14)
    other = "Or an instrumentation amplifier (gain 500) with A+ and A− in, and an ADC of 16 bits."
    sheet.text(20, 316, other, GREY, size=14)
    return sheet


DRAWINGS: dict[str, Callable[[], Sheet]] = {
    "idea": idea,
    "rig": rig,
    "jig": jig,
    "bench": bench,
    "light": light,
    "load": load,
    "circuit": circuit,
    "sign": sign,
    "floors": floors,
}


STEPS: dict[str, Callable[[], Sheet]] = {
    "board": rulers,
    "lens": poses,
    "plane": bench,
    "noload": light,
    "loads": load,
    "sensor": sign,
}
"""Step of the wizard → its drawing."""


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    for folder, drawings in ((FOLDER, DRAWINGS), (OF_STEPS, {f"step_{name}": draw for name, draw in STEPS.items()})):
        for name, draw in drawings.items():
            (folder / f"{name}.svg").write_text(draw().svg(), encoding="utf-8")
