"""The scenario, asked for over the network by processes that know only the run's name and an endpoint."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import msgpack
import zenoh

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.messages import VERSION, BadMessage, unpack


@dataclass(frozen=True)
class ScenarioText:
    """A scenario as written and as resolved, both TOML, and the version of the program that serves it.

    step: the last one that the run has begun, None before its start. agents: who takes part in it then. faults: those
    that were injected meanwhile, a JSON list of tables, or empty.
    """

    source: str
    resolved: str
    program: str
    step: int | None = None
    agents: tuple[int, ...] = ()
    faults: str = ""


def serve_scenario(session: zenoh.Session, run: str, text: Callable[[], ScenarioText]) -> zenoh.Queryable[None]:
    """Answer queries for the scenario, as it is then, until the returned queryable is dropped."""
    key = Keys(run).scenario

    def reply(query: zenoh.Query) -> None:
        with query:
            query.reply(key, msgpack.packb({"v": VERSION, "run": run, **asdict(text())}))

    return session.declare_queryable(key, reply)


def fetch_scenario(
    session: zenoh.Session, run: str, *, patience: float, stopped: Callable[[], bool] = lambda: False
) -> ScenarioText:
    """Ask for the scenario, again and again for `patience` s. Raises UserError when nobody answers rightly."""
    until = time.monotonic() + patience
    while not stopped():
        for reply in session.get(Keys(run).scenario, timeout=1.0):
            if reply.ok is not None:
                return _read(reply.ok.payload.to_bytes(), run)
        if time.monotonic() > until:
            break
        time.sleep(0.03)
    raise UserError(
        f"no target of run {run!r} answers within {patience:g} s; check --run and --connect, "
        "and start 'zenoh-cbef target' first"
    )


def _read(data: bytes, run: str) -> ScenarioText:
    try:
        answer = unpack(data)
    except BadMessage as error:
        raise UserError(f"run {run!r} answers with something that is no scenario ({error})") from None
    if answer.get("v") != VERSION:
        raise UserError(
            f"run {run!r} speaks protocol version {answer.get('v')}, this program {VERSION}; "
            "install the same zenoh-cbef on every host"
        )
    parts = [answer.get(name) for name in ("source", "resolved", "program")]
    if not all(isinstance(part, str) for part in parts):
        raise UserError(f"run {run!r} answers with something that is no scenario; is its target a zenoh-cbef?")
    step, agents, faults = (answer.get(name) for name in ("step", "agents", "faults"))
    source, resolved, program = (str(part) for part in parts)
    return ScenarioText(
        source,
        resolved,
        program,
        step=step if isinstance(step, int) else None,
        agents=tuple(one for one in agents if isinstance(one, int)) if isinstance(agents, list) else (),
        faults=faults if isinstance(faults, str) else "",
    )
