"""The lens models of camera.json; their maps are the core's (native/src/lens_maps.hpp), for tensors those in `tensors`.

"opencv" is OpenCV's lens: rational radial terms, decentring, thin prism, tilted sensor; without coefficients a pinhole.
"fisheye" is Kannala and Brandt's: the image radius is θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸), θ the axis' angle.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LensModel:
    """A lens model: its name in camera.json, its coefficients in file order, and how many of these a camera may
    have."""

    name: str
    coefficient_names: tuple[str, ...]
    counts: tuple[int, ...]

    @property
    def is_fisheye(self) -> bool:
        """Whether the model maps the angle from the axis, not the position on the plane z = 1."""
        return self.name == "fisheye"


MODELS = {
    model.name: model
    for model in (
        LensModel(
            "opencv",
            ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y"),
            (0, 4, 5, 8, 12, 14),
        ),
        LensModel("fisheye", ("k1", "k2", "k3", "k4"), (4,)),
    )
}  # name in camera.json → model
