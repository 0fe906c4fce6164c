"""The replay process: a log is published again."""
