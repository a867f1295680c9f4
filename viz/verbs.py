"""The verbs of this package: name → (module with `configure` and `run`, one line of help)."""

VERBS = {
    "reconstruct": ("viz.reconstruct_cli", "contacts to the object's surface: .vtp or .ply"),
    "view": ("viz.view_cli", "the 3-D scene as a window, a PNG or a self-contained HTML page"),
}
