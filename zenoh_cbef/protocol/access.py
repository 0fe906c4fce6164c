"""Who may say and hear what: Zenoh's access control by the common name of the other end's certificate.

Every process and every router enforces the same rules on what comes in, whatever run it is of. What no rule allows is
dropped, so a link without a certificate carries nothing. What goes out is free: it is the receiver who checks.
"""

from __future__ import annotations

from typing import Any

from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.tls import common_name

AGENTS = 1000
"""Agents that have rules: as many as a scenario can have."""

_ANY = Keys("*")
_HEAR = ["declare_subscriber"]
_ASK = ["query", "liveliness_query", "declare_liveliness_subscriber"]
_SAY = ["put", "declare_queryable", "reply"]
_LIVE = ["liveliness_token"]
_ALL = [*_SAY, "delete", *_HEAR, *_ASK, *_LIVE]

Rule = tuple[list[str], list[str]]
"""Kinds of messages, and the keys that they are allowed on."""

_OF_AGENTS = f"{_ANY.root}/agent/*/*"
_EVERYBODY: list[Rule] = [(_ASK, [_ANY.scenario, _ANY.all_live, _OF_AGENTS]), (["put"], [_ANY.event])]
_READERS: list[Rule] = [*_EVERYBODY, (_HEAR, [_ANY.everything])]


def _token(name: str) -> str:
    return _ANY.all_live.replace("**", name)


def _agent(agent: int) -> list[Rule]:
    # What agents say to each other any agent may hear, but beacons only its own, and the truth none.
    own = f"{_ANY.root}/agent/{agent}/*"
    return [
        *_EVERYBODY,
        (_SAY, [own]),
        (_HEAR, [_ANY.beacon(agent), _ANY.faults, _OF_AGENTS]),
        (_LIVE, [_token(f"agent/{agent}"), _token(f"ready/{agent}")]),
    ]


_ROLES: dict[str, list[Rule]] = {
    "target": [
        *_READERS,
        (_SAY, [_ANY.scenario, _ANY.control, _ANY.faults, f"{_ANY.root}/target/*", f"{_ANY.root}/beacon/*"]),
        (_LIVE, [_token("target/*")]),
    ],
    "record": [*_READERS, (_LIVE, [_token("record/*"), _token("heard/**")])],
    # Each publishes what it measures, and hears there when the run starts and ends.
    "receiver": [*_EVERYBODY, (["put", *_HEAR], [f"{_ANY.root}/beacon/*"])],
    "operator": [*_READERS, (_ASK, [_ANY.control, _ANY.replay])],
    # A router passes on what it has checked itself; a replay speaks for everybody who was recorded.
    "router": [(_ALL, [_ANY.everything])],
    "replay": [(_ALL, [_ANY.everything])],
}


def access_control() -> dict[str, Any]:
    """Zenoh's access_control section."""
    roles = _ROLES | {common_name("agent", str(agent)): _agent(agent) for agent in range(AGENTS)}
    rules: list[dict[str, Any]] = [
        {"id": "out", "permission": "allow", "flows": ["egress"], "messages": _ALL, "key_exprs": [_ANY.everything]}
    ]
    policies = []
    for name, allowed in roles.items():
        own = [f"{name} {number}" for number in range(len(allowed))]
        rules += [
            {"id": rule, "permission": "allow", "flows": ["ingress"], "messages": messages, "key_exprs": keys}
            for rule, (messages, keys) in zip(own, allowed, strict=True)
        ]
        policies.append({"id": name, "rules": ["out", *own], "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": name, "cert_common_names": [name]} for name in roles],
        "policies": policies,
    }
