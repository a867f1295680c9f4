"""A drawing as vector PDF, to exact scale, for viewers that are told not to scale it."""

from __future__ import annotations

import io

from reportlab.pdfgen.canvas import FILL_EVEN_ODD, Canvas

from .sheet_layout import font_name
from .sheet_paper import Drawing, Label, Shape, Stroke

PT_PER_MM = 72 / 25.4


def as_pdf(drawing: Drawing) -> bytes:
    """The PDF; the same drawing gives the same bytes."""
    stream = io.BytesIO()
    size = drawing.width_mm * PT_PER_MM, drawing.height_mm * PT_PER_MM
    canvas = Canvas(stream, pagesize=size, invariant=1, pageCompression=1, lang="en")
    canvas.setTitle(drawing.title)
    canvas.setSubject(drawing.subject)
    canvas.setAuthor("vbaa-calib")
    canvas.setCreator("vbaa board")
    canvas.setKeywords("ChArUco, calibration board")
    canvas.setViewerPreference("PrintScaling", "None")
    for mark in drawing.marks:
        _put(canvas, mark, drawing.height_mm)
    canvas.showPage()
    canvas.save()
    return stream.getvalue()


def _put(canvas: Canvas, mark: Shape | Stroke | Label, height: float) -> None:
    if isinstance(mark, Shape):
        path = canvas.beginPath()
        for (x, y), *rest in mark.loops:
            path.moveTo(x * PT_PER_MM, (height - y) * PT_PER_MM)
            for u, v in rest:
                path.lineTo(u * PT_PER_MM, (height - v) * PT_PER_MM)
            path.close()
        canvas.drawPath(path, stroke=0, fill=1, fillMode=FILL_EVEN_ODD)
    elif isinstance(mark, Stroke):
        canvas.setLineWidth(mark.width * PT_PER_MM)
        ends = (mark.x0, height - mark.y0, mark.x1, height - mark.y1)
        canvas.line(*(end * PT_PER_MM for end in ends))
    else:
        canvas.saveState()
        canvas.setFont(font_name(mark.bold), mark.size_mm * PT_PER_MM)
        canvas.translate(mark.x * PT_PER_MM, (height - mark.y) * PT_PER_MM)
        canvas.rotate(90 if mark.turned else 0)
        put = {"start": canvas.drawString, "middle": canvas.drawCentredString, "end": canvas.drawRightString}
        put[mark.anchor](0, 0, mark.text)
        canvas.restoreState()
