"""Looks at runs, or ends them, from outside: it stands above the protocol alone."""
