"""Contacts while the pictures come in."""

from .estimator import LiveContact, LiveEstimator
