"""The verbs of this package: name → (module with `configure` and `run`, one line of help)."""

VERBS = {
    "check": ("viz.cli.check", "is this rig still right? a report and a plain verdict"),
    "estimate": (
        "viz.cli.estimate",
        "a recording to contacts.csv and report.html: where and how hard, with standard deviations",
    ),
    "look": ("viz.cli.look", "what is seen of the antenna in one picture, in words and as a debug picture"),
    "reconstruct": ("viz.cli.reconstruct", "contacts to the object's surface and stiffness: .vtp, .ply or .glb"),
    "report": ("viz.cli.report", "contacts as a page to read: plots, map, friction cone, table"),
    "view": ("viz.cli.view", "the 3-D scene as a window, a PNG or a self-contained HTML page"),
}
