"""What each process may send and hear: Zenoh's access control by the common name of the other end's certificate.

Every process and every router enforces the same rules on messages that come in, whatever their run is. It drops a
message that no rule allows, so a link without a certificate carries nothing. Of messages that go out it checks
publications alone: while a link is being made, Zenoh also sends the other end what that end has not subscribed to.
"""

from __future__ import annotations

from zenoh_cbef.plain import Json
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.tls import common_name
from zenoh_cbef.protocol.tokens import claim_token, life_token, over_token, ready_token
from zenoh_cbef.quantities import MOST_AGENTS

_ANY = Keys("*")
_HEAR = ["declare_subscriber"]
_ASK = ["query", "liveliness_query", "declare_liveliness_subscriber"]
_PUT = ["put"]
_ANSWER = ["declare_queryable", "reply"]
_LIVE = ["liveliness_token"]
_ALL = [*_PUT, *_ANSWER, "delete", *_HEAR, *_ASK, *_LIVE]

Rule = tuple[list[str], list[str]]
"""Kinds of messages, and the keys that they are allowed on."""

_OF_AGENTS = f"{_ANY.root}/agent/*/*"
_OF_TARGET = [_ANY.truth, _ANY.faults, _ANY.all_beacons, _ANY.all_signals, _ANY.event("target")]
_READERS: list[Rule] = [
    # A process may also ask for past messages that it may hear: their sender keeps the latest.
    (_ASK, [_ANY.scenario, _ANY.all_live, _OF_AGENTS, *_OF_TARGET, _ANY.all_events]),
    (_HEAR, [_ANY.everything]),
]


def _token(name: str) -> str:
    return _ANY.all_live.replace("**", name)


def _agent(agent: int) -> list[Rule]:
    # Any agent may hear what agents send each other, and its own beacons; no agent may hear the truth.
    name = f"agent/{agent}"
    own = [_ANY.range(agent), _ANY.round(agent), _ANY.estimate(agent), _ANY.event(name)]
    heard = [_ANY.beacon(agent), _ANY.signal(agent), _ANY.faults, _OF_AGENTS]
    return [
        (_PUT + _ANSWER, own),
        (_ANSWER, [_ANY.of_agent(agent)]),
        (_HEAR, heard),
        (_ASK, [_ANY.scenario, _ANY.claims, _ANY.links(name), _ANY.all_live, *heard]),
        (_LIVE, [_token(name), _token(over_token(name)), _token(ready_token(agent))]),
        (_LIVE, [_token(life_token(name, "*")), _token(claim_token(name, "*"))]),
    ]


_ROLES: dict[str, list[Rule]] = {
    "target": [
        *_READERS,
        (_PUT + _ANSWER, _OF_TARGET),
        (_ANSWER, [_ANY.scenario, _ANY.claims, _ANY.all_links, _ANY.control]),
        (_ASK, [_ANY.reached("**")]),
        (_LIVE, [_ANY.target_live, _token(over_token("target/target"))]),
        (_LIVE, [_token(life_token("target/target", "*"))]),
    ],
    "record": [
        *_READERS,
        (_PUT + _ANSWER, [_ANY.event("record/**")]),
        (_ANSWER, [_ANY.reached("record/*"), _ANY.log("record/*")]),
        (_ASK, [_ANY.claims, _ANY.links("record/*")]),
        (_LIVE, [_token("record/*"), _token(claim_token("record/*", "*")), _token("heard/**")]),
    ],
    # Each publishes what it measures, and hears when the run starts and ends.
    "receiver": [
        (_ASK, [_ANY.scenario, _ANY.all_live]),
        (_PUT, [_ANY.all_beacons, _ANY.event("receiver/*")]),
        (_HEAR, [_ANY.all_signals]),
    ],
    "operator": [*_READERS, (_ASK, [_ANY.control, _ANY.replay, _ANY.log("**")])],
    # A router passes on messages that it has checked; a replay speaks for all recorded processes.
    "router": [(_ALL, [_ANY.everything])],
    "replay": [(_ALL, [_ANY.everything])],
}


def access_control(*, detour: bool = False) -> dict[str, Json]:
    """Zenoh's access_control section. detour: for a client of the target, to which it passes on what others say."""
    roles = _ROLES | {common_name("agent", str(agent)): _agent(agent) for agent in range(MOST_AGENTS)}
    if detour:
        roles["target"] = _ROLES["router"]
    rules = [_rule("out", "egress", [one for one in _ALL if one not in _PUT], [_ANY.everything])]
    policies = []
    for name, allowed in roles.items():
        own = [f"{name} {number}" for number in range(len(allowed))]
        rules += [_rule(rule, "ingress", messages, keys) for rule, (messages, keys) in zip(own, allowed, strict=True)]
        heard = [key for messages, keys in allowed if set(_HEAR) <= set(messages) for key in keys]
        rules.append(_rule(f"{name} hears", "egress", _PUT, heard))
        policies.append({"id": name, "rules": ["out", *own, f"{name} hears"], "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": name, "cert_common_names": [name]} for name in roles],
        "policies": policies,
    }


def _rule(name: str, flow: str, messages: list[str], keys: list[str]) -> dict[str, Json]:
    return {"id": name, "permission": "allow", "flows": [flow], "messages": [*messages], "key_exprs": [*keys]}
