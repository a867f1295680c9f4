"""The systems around the paper under one interface, as baselines: `run_method(name, press)` gives an `Answer`.

They are kept as their authors had them, with their assumptions; `METHODS` lists them. The estimator itself is
`estimator.ContactEstimator`.
"""

from .methods import METHODS, run_method
from .press import Answer, Noise, Press, Ring, Wire, press_from_recording

__all__ = ["METHODS", "Answer", "Noise", "Press", "Ring", "Wire", "press_from_recording", "run_method"]
