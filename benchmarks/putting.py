"""Puts functions in the place of others, and imports nothing, as programs that are watched import this first."""


def put(owner: object, name: str, what: object) -> None:
    """Put something in the place of a method or function, for which an assignment would be of a wrong type."""
    setattr(owner, name, what)
