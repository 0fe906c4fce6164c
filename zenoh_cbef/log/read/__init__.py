"""From a log to arrays."""
