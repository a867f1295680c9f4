"""How the report of a recording looks: as the check report, and more. One small script: a cursor through all times."""

from __future__ import annotations

from viz.check.style import STYLE as BASE

STYLE = (
    BASE
    + """
  header .verdict { font-size: 27px; }
  dl.facts { display: grid; grid-template-columns: 9.5em 1fr; gap: 7px 18px; margin: 14px 0 0; }
  dl.facts dt { color: var(--soft); font-weight: 600; } dl.facts dd { margin: 0; max-width: 54em; }
  dl.facts dd.open { color: var(--soft); } dl.facts dd.look::before { content: "▲ "; color: #b45309; }
  figure { margin: 0 0 18px; } figure:last-child { margin: 0; } figure + figure { max-width: 800px; }
  img { width: 100%; border-radius: 8px; display: block; } figcaption { color: var(--soft); margin-top: 6px; }
  svg.time { margin: 0 0 6px; cursor: crosshair; } svg.time .cursor { stroke: #1f2937; pointer-events: none; }
  svg.time .cursor-time { fill: #1f2937; pointer-events: none; }
  .three { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 300px), 1fr)); gap: 8px 14px; }
  .three > *, .pair > * { min-width: 0; }
  .keys { color: var(--soft); font-size: 14px; margin: 8px 0 0; }
  .keys > span { margin-right: 22px; display: inline-block; }
  .ramp i { display: inline-block; width: 18px; height: 10px; }
  i.dot { display: inline-block; width: 10px; height: 10px; border-radius: 50%; margin-right: 6px;
          border: 1px solid rgba(31, 41, 55, .35); }
  .scroll { max-height: 620px; } td, th { white-space: nowrap; }
  td.reason, span.told { white-space: normal; min-width: 20em; } span.told { display: inline-block; }
  table.words td { white-space: normal; text-align: left; vertical-align: top; } td.path { overflow-wrap: anywhere; }
  table.words td:first-child { white-space: nowrap; }
  .good { color: #0f766e; } .bad { color: #b91c1c; font-weight: 600; }
  .times { overflow-x: auto; }
  @media (max-width: 720px) {
    svg.time { min-width: 700px; }
    dl.facts { grid-template-columns: 1fr; gap: 2px; } dl.facts dd { margin-bottom: 8px; }
  }
"""
)

SCRIPT = """
(() => {
  const plots = [...document.querySelectorAll("svg.time")], name = "http://www.w3.org/2000/svg";
  const made = plots.map(plot => {
    const box = plot.viewBox.baseVal, line = document.createElementNS(name, "line");
    const text = document.createElementNS(name, "text");
    line.setAttribute("class", "cursor"); text.setAttribute("class", "cursor-time");
    line.setAttribute("y1", 30); line.setAttribute("y2", box.height - 18);
    text.setAttribute("y", 27); plot.append(line, text); return { plot, line, text, width: box.width };
  });
  const hide = () => made.forEach(({ line, text }) => { line.style.display = text.style.display = "none"; });
  const show = event => {
    const at = event.currentTarget.getBoundingClientRect();
    made.forEach(({ plot, line, text, width }) => {
      const x = (event.clientX - at.left) / at.width * width, area = plot.dataset;
      const share = (x - area.left) / (area.right - area.left);
      if (share < 0 || share > 1) return hide();
      line.style.display = text.style.display = "";
      line.setAttribute("x1", x); line.setAttribute("x2", x); text.setAttribute("x", x + 4);
      text.textContent = (+area.first + share * (area.last - area.first)).toFixed(3) + " s";
    });
  };
  hide();
  plots.forEach(plot => { plot.addEventListener("mousemove", show); plot.addEventListener("mouseleave", hide); });
})();
"""
