"""Printed boards: specification, sheets, scale of the print."""
