"""The verbs of this package: name → (module with `configure` and `run`, one line of help)."""

VERBS = {
    "estimate": ("estimator.cli", "a recording to contacts.csv: where and how hard, with standard deviations"),
}
