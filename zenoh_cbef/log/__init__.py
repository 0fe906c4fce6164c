"""MCAP: write, read, verify, export."""
