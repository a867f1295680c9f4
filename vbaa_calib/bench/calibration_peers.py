"""Other calibrators: which are installed, and why they have no numbers."""

from __future__ import annotations

from importlib.util import find_spec

PEERS = {"lensboy": "pip install lensboy", "mrcal": "apt install python3-mrcal"}
"""Importable name → where to get it."""


def not_run() -> dict[str, str]:
    """Name of each peer and why this benchmark has no numbers of it."""
    return {
        name: f"absent ({remedy})" if find_spec(name) is None else "installed, but not driven by this benchmark"
        for name, remedy in PEERS.items()
    }
