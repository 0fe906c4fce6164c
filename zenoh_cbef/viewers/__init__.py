"""A run as other programs show or read it: scenes for Foxglove and Rerun, plain arrays."""
