"""What a test of a plug-in raises."""

from __future__ import annotations


class Nonconforming(AssertionError):
    """A plug-in does not do what runs rely on: one sentence that says what, and what to do."""
