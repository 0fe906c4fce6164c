"""Whether a process of a run is there and answers, for the program that has to restart it if it does not."""

from __future__ import annotations

from zenoh_cbef.errors import UserError
from zenoh_cbef.outside.operator import Operator
from zenoh_cbef.protocol.control import ask_control
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.questions import STATUS
from zenoh_cbef.protocol.reach import wait_for_link, why_no_answer
from zenoh_cbef.protocol.session import Connection

_TARGET = "target/target"
_ANSWER_SECONDS = 1.0


def is_there(connection: Connection, run: str, name: str, patience: float) -> bool:
    """Whether a process, as in "agent/3", is in a run that is on. One that hangs leaves it with its lease.

    Raises UserError where no process answers within `patience` s, and where no such run is on.
    """
    with Operator(run, connection, patience) as operator:
        if not wait_for_link(operator.session, patience):
            raise UserError(f"run {run!r} does not answer: {why_no_answer(operator.session, connection, run)}")
        live = operator.processes()
        if name in live:
            return True
        if _TARGET not in live:
            raise UserError(f"no run {run!r} is on; check --run, or start its target")
        # Peers do not relay: a session that is linked to the target alone sees no other process, but the target does.
        told = ask_control(operator.session, Keys(run).control, STATUS, timeout=_ANSWER_SECONDS)
        return told is not None and name in told["live"]
