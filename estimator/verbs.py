"""The verbs of this package: name → (module with `configure` and `run`, one line of help)."""

VERBS = {
    "budget": ("estimator.budget_cli", "what limits this rig's contacts, and what to improve first"),
    "track": ("estimator.track_cli", "contacts in time: first contact, loss, slip and stick, ringing"),
}
