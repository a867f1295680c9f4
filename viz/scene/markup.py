"""Words and blocks of the reports as HTML."""

from __future__ import annotations

import re
from html import escape


def sentence(text: str) -> str:
    """With a capital at its begin and a full stop at its end."""
    text = text.strip().rstrip(".")
    return f"{text[:1].upper()}{text[1:]}."


def prose(text: str) -> str:
    """Plain text as HTML; what stands in backquotes is a command."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text))


def section(heading: str, how: str, body: str) -> str:
    """A heading, how to read what follows, and that."""
    return f'<section><h2>{escape(heading)}</h2><p class="how">{escape(how)}</p>{body}</section>'
