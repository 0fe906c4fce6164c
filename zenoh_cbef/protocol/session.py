"""Zenoh sessions: opened from a few settings, with every failure as a sentence."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zenoh

from zenoh_cbef.errors import UserError

_ENDPOINT = re.compile(r"^(tcp|udp|tls|quic|ws|unixsock-stream)/[^\s]+$")
ONE_RUNTIME = "(rx:(handover:app),acc:(handover:app),tx:(handover:app),net:(handover:app),app:(worker_threads:1))"
"""Value of ZENOH_RUNTIME that merges Zenoh's runtimes into one worker thread: faster where cores are few.

Not for sessions with gossip, whose churn can stall a single worker.
"""


@dataclass(frozen=True)
class Connection:
    """How a process joins the network.

    connect, listen: endpoints such as tcp/127.0.0.1:7447. mode: peer, or client of a router. gossip: peers tell
    each other about third ones and link to them. lease_ms: how long a silent link is taken to be alive.
    config: a Zenoh configuration file that these settings are laid over.
    """

    connect: Sequence[str] = ()
    listen: Sequence[str] = ()
    mode: str = "peer"
    gossip: bool = True
    multicast: bool = False
    lease_ms: int = 5000
    config: str | None = None


def yield_to_others() -> None:
    """Ask the scheduler for fewer preemptions; the threads of sessions opened later inherit it."""
    if hasattr(os, "sched_setscheduler"):
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


def open_session(connection: Connection) -> zenoh.Session:
    """Open a session. Links to endpoints that do not answer yet are made as soon as they do.

    Raises UserError for an endpoint that is none, a port in use, or a configuration file that Zenoh refuses.
    """
    for endpoint in (*connection.connect, *connection.listen):
        if not _ENDPOINT.match(endpoint):
            raise UserError(f"{endpoint!r} is no endpoint; write it as tcp/HOST:PORT, for example tcp/127.0.0.1:7447")
    config = _config(connection)
    zenoh.init_log_from_env_or("off")
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise UserError(_explain(str(error), connection)) from None


def _config(connection: Connection) -> zenoh.Config:
    if connection.config is None:
        config = zenoh.Config()
    else:
        if not Path(connection.config).is_file():
            raise UserError(f"there is no Zenoh configuration file {connection.config}")
        try:
            config = zenoh.Config.from_file(connection.config)
        except zenoh.ZError as error:
            raise UserError(f"Zenoh refuses {connection.config}: {error}") from None
    settings: dict[str, Any] = {
        "mode": connection.mode,
        "scouting/multicast/enabled": connection.multicast,
        "scouting/gossip/enabled": connection.gossip,
        "connect/timeout_ms": 0 if connection.mode == "client" else -1,
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 50, "period_max_ms": 400, "period_increase_factor": 1.5},
        "listen/exit_on_failure": True,
        "transport/link/tx/lease": connection.lease_ms,
        "transport/shared_memory/enabled": False,
    }
    if connection.connect:
        settings["connect/endpoints"] = list(connection.connect)
    if connection.listen or connection.mode == "peer":
        settings["listen/endpoints"] = list(connection.listen) or ["tcp/127.0.0.1:0"]
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _explain(error: str, connection: Connection) -> str:
    endpoints = ", ".join(connection.listen)
    if "in use" in error.lower() or "os error 98" in error.lower():
        return f"a port of {endpoints} is in use; choose another with --listen, or end the process that holds it"
    if connection.listen and "listen" in error.lower():
        return f"cannot listen on {endpoints}: {_last_cause(error)}; choose another endpoint with --listen"
    return f"Zenoh cannot open a session: {_last_cause(error)}; check --connect and --listen"


def _last_cause(error: str) -> str:
    return re.sub(r" at \S+\.rs:\d+.*", "", error).rsplit(": ", 1)[-1].strip(" !]") or error
