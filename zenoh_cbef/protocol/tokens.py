"""Names of processes, as in "agent/3", and the liveliness tokens that tell others of them.

A token is the name itself while its process is there, or a word about it: which process this is (`life`), that it
claims the name, is ready, has heard another one, or leaves for good (`over`).
"""

from __future__ import annotations

import re

from zenoh_cbef.protocol.keys import ID, agent_named

_LIVING = rf"agent/(?:{ID})|target/target|replay/replay"
_RECORDER = "record/[^/*$]{1,200}"
_TOKENS = re.compile(rf"(?:over/)?(?:{_LIVING})|ready/(?:{ID})")
_CHOSEN_TOKENS = re.compile(
    rf"{_RECORDER}|(?:life/(?:{_LIVING})|claim/(?:{_LIVING}|{_RECORDER}))/[0-9a-f]{{1,40}}"
    rf"|heard/(?:target|agent/(?:{ID}))/[0-9]{{1,20}}"
)
_LIFE, _OVER = "life/", "over/"


def can_be_claimed(process: str) -> bool:
    """Whether there is one process of this name, as in "agent/3" or "record/host-b", that the target gives it to."""
    return agent_named(process) is not None or re.fullmatch(_RECORDER, process) is not None


def in_words(process: str) -> str:
    """The name of a process, as in "agent/3" or "target/target", as people read it: "agent 3", "target"."""
    role, _, name = process.partition("/")
    return role if name in {"", role} else f"{role} {name}"


def leads(token: str) -> bool:
    """Whether a liveliness token says that a target, or a replay in its place, is there."""
    return token in {"target/target", "replay/replay"}


def is_expected(token: str) -> bool:
    """Whether a liveliness token says that a process is there whose messages a recorder waits for."""
    return agent_named(token) is not None or leads(token)


def is_recorder(token: str) -> bool:
    """Whether a liveliness token says that a recorder is there."""
    return token.startswith("record/")


def ready_token(agent: int) -> str:
    """The token with which an agent says that it has all that it needs for its first step."""
    return f"ready/{agent}"


def claim_token(process: str, life: str) -> str:
    """The token with which a process claims a name. life: its session's id."""
    return f"claim/{process}/{life}"


def heard_token(sender: str, word: int | str) -> str:
    """The token with which a recorder says that it has heard the last words of a process, "*" for any of them."""
    return f"heard/{sender}/{word}"


def life_token(process: str, life: str) -> str:
    """The token that says which process of a name this is. life: its session's id, "*" for any."""
    return f"{_LIFE}{process}/{life}"


def life_told(token: str) -> tuple[str, str] | None:
    """The name and the life that a token of `life_token` tells; None for another token."""
    process, _, life = token.removeprefix(_LIFE).rpartition("/")
    return (process, life) if token.startswith(_LIFE) else None


def over_token(process: str) -> str:
    """The token with which a process says that its name does not come back."""
    return f"{_OVER}{process}"


def over_told(token: str) -> str | None:
    """The name that a token of `over_token` tells; None for another token."""
    return token.removeprefix(_OVER) if token.startswith(_OVER) else None


def is_token(name: str, *, chosen: bool) -> bool:
    """Whether a run can have a liveliness token of this name, as in "agent/3".

    chosen: of a name that its process chooses at least in part, of which there can be any number.
    """
    return (_CHOSEN_TOKENS if chosen else _TOKENS).fullmatch(name) is not None
