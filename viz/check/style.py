"""How the check report looks: dark on light, one column on a phone, nothing from elsewhere."""

from __future__ import annotations

STYLE = """
  :root { color-scheme: light; --ink: #1f2937; --soft: #5b6676; --line: #e2e8f0; }
  * { box-sizing: border-box; }
  body { margin: 0; background: #eef2f6; color: var(--ink);
         font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; }
  main { max-width: 1120px; margin: 0 auto; padding: 28px 22px 60px; }
  h1 { font-size: 15px; margin: 0; font-weight: 600; color: var(--soft); }
  h2 { font-size: 20px; margin: 0 0 4px; } h3 { font-size: 16px; margin: 22px 0 4px; }
  p { margin: 0 0 12px; } p.how { color: var(--soft); max-width: 46em; } p.none { color: var(--soft); }
  section, header { background: #fff; border-radius: 14px; padding: 22px 26px; margin: 0 0 18px;
                    box-shadow: 0 1px 4px rgba(31, 41, 55, .09); }
  header { border-top: 7px solid var(--level); }
  header .verdict { font-size: 31px; line-height: 1.2; font-weight: 700; margin: 4px 0 8px; color: var(--level); }
  header p { max-width: 52em; margin: 0 0 6px; }
  .finding { display: grid; grid-template-columns: 128px 1fr 210px; gap: 4px 18px; align-items: start;
             padding: 13px 0; border-top: 1px solid var(--line); }
  .finding:first-of-type { border-top: 0; }
  .chip { background: var(--level); color: #fff; border-radius: 99px; padding: 2px 12px; font-size: 13px;
          font-weight: 600; justify-self: start; white-space: nowrap; }
  .finding b { display: block; } .finding span.words { color: var(--soft); overflow-wrap: anywhere; }
  .finding .remedy { display: block; margin-top: 3px; } .finding .remedy::before { content: "→ "; }
  .measure { font-size: 12.5px; color: var(--soft); line-height: 1.35; }
  .pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 430px), 1fr)); gap: 14px 26px; }
  .pair > * { min-width: 0; }
  svg { width: 100%; height: auto; display: block; } svg path { fill: none; }
  svg.gauge { max-width: 210px; } svg.gauge path { fill: #1f2937; }
  svg text { font-size: 12.5px; fill: #5b6676; } svg text.title { font-size: 14px; font-weight: 600; fill: #1f2937; }
  svg text.halo { fill: #111827; font-size: 12px; font-weight: 600; paint-order: stroke; stroke: #fff;
                  stroke-width: 3px; stroke-linejoin: round; }
  svg .grid { stroke: #dde3ea; stroke-width: 1; }
  .scroll { overflow: auto; max-height: 460px; }
  table { border-collapse: collapse; width: 100%; font-size: 14px; font-variant-numeric: tabular-nums; }
  th { position: sticky; top: 0; background: #fff; text-align: right; font-weight: 600; color: var(--soft);
       border-bottom: 1px solid #cbd5e1; padding: 6px 9px; vertical-align: bottom; }
  td { text-align: right; padding: 4px 9px; border-bottom: 1px solid #f1f5f9; }
  th.text, td.text { text-align: left; } td small { color: var(--soft); white-space: nowrap; }
  .narrow { max-width: 24em; }
  code { font-size: 90%; background: #f1f5f9; border-radius: 4px; padding: 1px 4px; }
  footer { color: var(--soft); font-size: 13.5px; padding: 0 8px; }
  @media (max-width: 720px) {
    main { padding: 12px 10px 40px; } section, header { padding: 16px 15px; border-radius: 11px; }
    header .verdict { font-size: 25px; } .finding { grid-template-columns: 1fr; gap: 5px; }
    svg text { font-size: 15px; } svg text.title { font-size: 16.5px; } svg text.halo { font-size: 14.5px; }
    svg text.key { font-size: 13.5px; } th, td { padding: 4px 5px; } table { font-size: 13px; }
    .measure { font-size: 13px; }
  }
  @media print { body { background: #fff; } section, header { box-shadow: none; break-inside: avoid; } }
"""
