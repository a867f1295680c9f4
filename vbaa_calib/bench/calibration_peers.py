"""Other calibrators, where they are installed."""

from __future__ import annotations

from importlib.util import find_spec

PEERS = {"lensboy": "pip install lensboy", "mrcal": "apt install python3-mrcal"}
"""Importable name → where to get it."""


def absent() -> dict[str, str]:
    """Peers that cannot be imported here, and how to get them."""
    return {name: f"absent ({remedy})" for name, remedy in PEERS.items() if find_spec(name) is None}
