"""What is done with logs as files: recover, filter, merge, check, show. Every tool streams."""
