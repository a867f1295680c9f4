"""Excerpts below search results when the site is opened from disk, where browsers let no page read another one.

Sphinx's search fetches each page that it found to quote from it. Here the pages' text is a script of the site, and the
search page's `fetch` answers from it.
"""

from __future__ import annotations

import html
import json
import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

SCRIPT = "excerpts.js"
_MAIN = re.compile(r'<article[^>]*role="main"[^>]*>(.*?)</article>', re.DOTALL)
_DROPPED = re.compile(r'<(script|style|svg)\b.*?</\1>|<a class="headerlink".*?</a>', re.DOTALL)
_TAG = re.compile(r"<[^>]*>")
_SECTION = re.compile(r'<section[^>]*\bid="([^"]+)"[^>]*>')
_FETCH = """
(() => {
  const fetched = window.fetch;
  window.fetch = (url, ...more) => {
    const text = pages[String(url).split("/").pop().replace(/\\.html$/, "")];
    if (text === undefined) return fetched(url, ...more);
    return Promise.resolve(new Response(`<div role="main">${text}</div>`));
  };
})();
"""


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the script to the search page, and write it when all pages are there."""
    app.connect("html-page-context", _add)
    app.connect("build-finished", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _add(app: Sphinx, pagename: str, *_: Any) -> None:
    if pagename == "search":
        app.add_js_file(SCRIPT)


def _write(app: Sphinx, failed: Exception | None) -> None:
    if failed is None and app.builder.format == "html":
        texts = {name: text_of((Path(app.outdir) / f"{name}.html").read_text("utf-8")) for name in app.env.found_docs}
        script = f"const pages = {json.dumps(texts, ensure_ascii=False)};{_FETCH}"
        (Path(app.outdir) / "_static" / SCRIPT).write_text(script, encoding="utf-8")


def text_of(page: str) -> str:
    """A page's main text, of whose tags only the sections with their anchors are left."""
    main = _MAIN.search(page)
    if main is None:
        return ""
    kept = _SECTION.sub("\x01\\1\x02", _DROPPED.sub("", main[1])).replace("</section>", "\x03")
    words = " ".join(html.escape(html.unescape(_TAG.sub(" ", kept)), quote=False).split())
    return re.sub("\x01(.*?)\x02", r'<section id="\1">', words).replace("\x03", "</section>")
