"""The verbs of this package: name → (module with `configure` and `run`, one line of help)."""

VERBS = {
    "track": ("estimator.track_cli", "contacts in time: first contact, loss, slip and stick, ringing"),
}
