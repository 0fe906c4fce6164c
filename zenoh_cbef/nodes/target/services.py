"""What a target answers to other processes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from zenoh_cbef.nodes.target.control import Asked, answer
from zenoh_cbef.protocol.claims import Claims, serve_claims
from zenoh_cbef.protocol.control import serve_control
from zenoh_cbef.protocol.directory import Directory, serve_directory
from zenoh_cbef.protocol.scenario_service import ScenarioText, serve_scenario


class Serving(Asked, Protocol):
    """The parts of a target that its answers need."""

    claims: Claims
    directory: Directory


@contextmanager
def served(target: Serving, text: Callable[[], ScenarioText]) -> Iterator[None]:
    """Answer all questions until the block is left. text: the scenario, as it is then."""
    session, keys = target.node.session, target.node.keys
    services = [
        serve_control(session, keys.control, lambda request: answer(target, request)),
        serve_scenario(session, keys.run, text),
        serve_claims(session, keys.claims, target.claims),
        serve_directory(session, keys, target.directory),
    ]
    yield
    for service in services:
        service.undeclare()
