"""Peer-to-peer target tracking with consensus filters over Zenoh."""

__version__ = "0.1.0"
