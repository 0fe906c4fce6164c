"""Words of messages that depend on numbers, or on other words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches


def counted(number: int, what: str, several: str = "") -> str:
    """A number of things, as in "1 message" and "2 messages"; several: the plural where it does not end in s."""
    return f"{number} {what if number == 1 else several or what + 's'}"


def listed(words: Sequence[str]) -> str:
    """One or more words as a list, as in "a", "a and b" and "a, b and c"."""
    *before, last = words
    return f"{', '.join(before)} and {last}" if before else last


def first_of(words: Sequence[str], most: int) -> str:
    """A list of at most so many of one or more words, as in "a, b and 3 more" of five; a lone last one is named."""
    return listed(words if len(words) <= most + 1 else [*words[:most], f"{len(words) - most} more"])


def meant(wrong: str, known: Iterable[str], otherwise: str) -> str:
    """Whether a known word was meant that is like a wrong one; other advice where none is."""
    near = get_close_matches(wrong, list(known), 1)
    return f"did you mean {near[0]!r}?" if near else otherwise
