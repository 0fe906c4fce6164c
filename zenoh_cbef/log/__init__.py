"""Logs of runs: the file format, what writes them, reads them, proves them, and what is done with them as files."""
