"""The command line, `vbaa VERB ...`."""

from .main import main
