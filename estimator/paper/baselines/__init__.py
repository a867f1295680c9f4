"""Related systems under one interface, as baselines: `run_method(name, press)` returns an `Answer`.

They are implemented as published, with their assumptions; `METHODS` lists them. The estimator itself is
`estimator.ContactEstimator`.
"""

from .methods import METHODS, run_method
from .press import Answer, Press, Wire, press_from_recording

__all__ = ["METHODS", "Answer", "Press", "Wire", "press_from_recording", "run_method"]
