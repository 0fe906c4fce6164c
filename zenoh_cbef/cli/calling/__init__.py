"""How a verb is found, called, and ended."""
