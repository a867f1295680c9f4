"""The front door: `vbaa VERB ...`."""

from .main import main
