"""The steps of the wizard, in order. Each is a module with the same five names; `step.py` says which."""
