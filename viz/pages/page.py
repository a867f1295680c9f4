"""Templates to pages that stand alone: style, figures and script are inside, every value is escaped."""

from __future__ import annotations

import base64
import re
from functools import cache
from typing import Any

import jinja2
from markupsafe import Markup, escape

from .tables import number


def prose(text: str) -> Markup:
    """Plain text as HTML; what stands in backquotes is a command."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def render(template: str, **values: Any) -> str:
    """A page from one of the templates of this package."""
    return _environment().get_template(template).render(values)


@cache
def _environment() -> jinja2.Environment:
    made = jinja2.Environment(
        loader=jinja2.PackageLoader("viz.pages"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.policies["json.dumps_kwargs"] = {"allow_nan": False}
    made.filters |= {"prose": prose, "number": number, "base64": lambda data: base64.b64encode(data).decode()}
    return made
