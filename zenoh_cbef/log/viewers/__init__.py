"""Runs as the scenes that viewers show."""
