"""Logs of runs: the file format; writing, reading and proving logs; tools that make logs from logs."""
