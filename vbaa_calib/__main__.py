"""`python -m vbaa_calib` is `vbaa`."""

import sys
from importlib import import_module  # by name: the front door is above this folder

sys.exit(import_module("vbaa_calib.cli").main())
