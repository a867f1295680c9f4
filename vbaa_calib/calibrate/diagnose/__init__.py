"""What was typed wrong, and what does not hold still, in the pictures of the free and the loaded antenna."""

from .failure import explain_failure, with_cause
from .still_diagnoses import still_diagnoses
from .typed_loads import typed_load_doubts

__all__ = ["explain_failure", "still_diagnoses", "typed_load_doubts", "with_cause"]
