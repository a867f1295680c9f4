"""Speed against error, measured in one run with the alternatives beside us: `vbaa bench`."""
