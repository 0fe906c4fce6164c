"""Filters of other states, motions or payloads than a kind has, which `make_filter` takes in its place."""
