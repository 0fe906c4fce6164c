"""An agent's process that tells what its steps cost; it takes the arguments of `zenoh-cbef`.

Writes JSON into the file that WATCHED names: CPU seconds of the main thread in all steps; or, with WATCHED_CALLS, how
often each function was called in them, and how often from another file than its own.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections import Counter
from pathlib import Path
from types import FrameType

from zenoh_cbef.cli.main import main
from zenoh_cbef.nodes.agent.agent import Agent
from zenoh_cbef.nodes.agent.entrance import Entry

WATCHED, CALLS = "WATCHED", "WATCHED_CALLS"


def _run(agent: Agent, entry: Entry) -> int:
    calls: Counter[str] = Counter()
    across = 0

    def note(frame: FrameType, event: str, _: object) -> None:
        nonlocal across
        if event == "call":
            code, caller = frame.f_code, frame.f_back
            calls[f"{code.co_filename}:{code.co_qualname}"] += 1
            across += caller is not None and caller.f_code.co_filename != code.co_filename

    begin = time.thread_time()
    if CALLS in os.environ:
        sys.setprofile(note)
    last = _original(agent, entry)
    sys.setprofile(None)
    told = {"steps": last, "seconds": time.thread_time() - begin, "calls": dict(calls), "across": across}
    Path(os.environ[WATCHED]).write_text(json.dumps(told), encoding="utf-8")
    return last


_original = Agent.run

if __name__ == "__main__":
    setattr(Agent, "run", _run)  # noqa: B010 - a method of the very class that the verb uses
    main()
