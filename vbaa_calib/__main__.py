"""`python -m vbaa_calib` is `vbaa`."""

import sys

from vbaa_calib.cli.main import main

sys.exit(main())
