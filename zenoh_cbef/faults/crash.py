"""Agents that are killed."""

from __future__ import annotations

from typing import ClassVar, Literal

from zenoh_cbef.faults.absence import Absence


class Crash(Absence):
    """Agents' processes are killed (SIGKILL), and started again at `until`, if there is one.

    An agent that comes back remembers nothing, and begins with its neighbours' estimates.
    """

    kind: Literal["crash"]

    forgets: ClassVar[bool] = True
