"""Peer-to-peer target tracking with consensus filters over Zenoh."""

from pathlib import Path

from zenoh_cbef.checkout import commit

VERSION = "0.2.0"
_COMMIT = commit(Path(__file__).parents[1])

__version__ = f"{VERSION}+g{_COMMIT}" if _COMMIT else VERSION
"""The version, with the commit in a checkout."""
