"""What users typed, fit to be shown: without secrets, control characters and length."""

from __future__ import annotations

import re

_LONGEST = 100
_USER = re.compile(r"://.*@", re.DOTALL)
_SECRET = re.compile(r"([?&;][^=&;]*(?:pass|pwd|user|usr|token|key|auth|secret|sig)[^=&;]*=)[^&;#]*", re.IGNORECASE)


def without_secrets(text: str) -> str:
    """A URL without user, password and tokens.

    All up to the last @ goes, since a password may hold one, or a slash.
    """
    return _SECRET.sub(r"\1***", _USER.sub("://***@", text))


def shown(text: str) -> str:
    """A text for a message: one line, at most 100 characters, without secrets."""
    line = "".join(sign if sign.isprintable() else "?" for sign in without_secrets(text))
    return line if len(line) <= _LONGEST else f"{line[:_LONGEST]}…"
