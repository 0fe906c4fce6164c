"""An agent's process that tells what its steps cost; it takes the arguments of `zenoh-cbef`.

Writes JSON into the file that WATCHED names: CPU seconds of the main thread in all steps; or, with WATCHED_CALLS, how
often each function was called in them, and how often a call of this program's was in another file than the one before.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections import Counter
from pathlib import Path
from types import FrameType

import zenoh_cbef
from benchmarks.putting import put
from zenoh_cbef.cli.calling.main import main
from zenoh_cbef.nodes.agent.agent import Agent
from zenoh_cbef.nodes.agent.entrance import Entry

WATCHED, CALLS = "WATCHED", "WATCHED_CALLS"
OURS = f"{Path(zenoh_cbef.__file__).parent}{os.sep}"


def _run(agent: Agent, entry: Entry) -> int:
    calls: Counter[str] = Counter()
    changes, latest = 0, ""

    def note(frame: FrameType, event: str, _: object) -> None:
        nonlocal changes, latest
        if event == "call":
            code = frame.f_code
            calls[f"{code.co_filename}:{code.co_qualname}"] += 1
            if code.co_filename.startswith(OURS):
                changes += code.co_filename != latest
                latest = code.co_filename

    begin = time.thread_time()
    if CALLS in os.environ:
        sys.setprofile(note)
    last = _original(agent, entry)
    sys.setprofile(None)
    told = {"steps": last, "seconds": time.thread_time() - begin, "calls": dict(calls), "changes": changes}
    Path(os.environ[WATCHED]).write_text(json.dumps(told), encoding="utf-8")
    return last


_original = Agent.run

if __name__ == "__main__":
    put(Agent, "run", _run)
    main()
