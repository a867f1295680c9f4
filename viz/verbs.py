"""The verbs of this package: name → (module with `configure` and `run`, one line of help)."""

VERBS = {
    "check": ("viz.check_cli", "is this rig still right? a report and a plain verdict"),
    "look": ("viz.look_cli", "what is seen of the antenna in one picture, in words and as a debug picture"),
    "reconstruct": ("viz.reconstruct_cli", "contacts to the object's surface: .vtp or .ply"),
    "view": ("viz.view_cli", "the 3-D scene as a window, a PNG or a self-contained HTML page"),
}
