"""Diagnoses of pictures of the board: of a set once the lens is solved, and of one more picture against the others."""

from .resolution import resolution_changed
from .same_pose import same_pose
from .view_set import view_set_diagnoses

__all__ = ["resolution_changed", "same_pose", "view_set_diagnoses"]
