"""The systems around the paper under one interface, as baselines: `ask(name, press)` gives a `Reading`.

They are kept as their authors had them, with their assumptions; `METHODS` lists them. The estimator itself is
`estimator.ContactEstimator`.
"""

from .methods import METHODS, NEEDS, Method, ask
from .press import Noise, Press, Reading, Ring, Wire, press_seen, tared, world_turn

__all__ = [
    "METHODS",
    "NEEDS",
    "Method",
    "Noise",
    "Press",
    "Reading",
    "Ring",
    "Wire",
    "ask",
    "press_seen",
    "tared",
    "world_turn",
]
