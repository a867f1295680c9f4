"""The verbs of this package: name → (module with `configure` and `run`, one line of help)."""

VERBS = {
    "budget": ("estimator.cli.budget", "what limits this rig's contacts, and what to improve first"),
    "track": ("estimator.cli.track", "contacts in time: first contact, loss, slip and stick, ringing"),
}
