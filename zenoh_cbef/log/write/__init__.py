"""A log that is being written, by a recorder or from a computed run."""
