"""Contacts from centrelines."""
