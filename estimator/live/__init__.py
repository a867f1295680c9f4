"""Contacts while the pictures come."""

from .estimator import LiveContact, LiveEstimator
