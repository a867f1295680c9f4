"""`python -m vbaa_calib.cli` is `vbaa`."""

import sys

from .main import main

sys.exit(main())
