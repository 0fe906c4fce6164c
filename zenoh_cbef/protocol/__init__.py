"""Key expressions, messages and sessions: the only package that imports zenoh."""
