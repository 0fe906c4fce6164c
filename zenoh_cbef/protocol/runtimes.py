"""The threads of Zenoh in a process: the value of ZENOH_RUNTIME, which Zenoh reads once, before its first session.

Zenoh 1.10 keeps a thread of its runtime for each link that begins or ends, until others have begun or ended. It has 50
places for such threads by default. When all are taken, these links wait for one another, and no further one is ever
made. So each runtime has as many places here as the process accepts links; a thread is there only while it is needed.
"""

from __future__ import annotations

import os

RUNTIME = "ZENOH_RUNTIME"
"""The environment variable."""
MOST_LINKS = 10_000
"""Links that a process accepts: ten for each agent that a scenario can have."""
_ROOM = f"max_blocking_threads:{MOST_LINKS}"
ROOMY_RUNTIMES = f"(app:({_ROOM}),acc:({_ROOM}),tx:({_ROOM}),rx:({_ROOM}),net:({_ROOM}))"
"""Zenoh's own five runtimes, with that room."""
ONE_RUNTIME = (
    f"(rx:(handover:app),acc:(handover:app),tx:(handover:app),net:(handover:app),app:(worker_threads:1,{_ROOM}))"
)
"""The same, merged into one worker thread: faster where cores are few.

Not for sessions with gossip, whose churn can stall a single worker.
"""


def have_room() -> None:
    """Give Zenoh's runtimes room for threads, unless a launcher or a user has chosen."""
    os.environ.setdefault(RUNTIME, ROOMY_RUNTIMES)
