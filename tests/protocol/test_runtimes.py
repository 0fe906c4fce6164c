"""Zenoh's room for threads: as many links may begin or end at once as a process accepts."""

import os
import subprocess
import sys

import pytest

from zenoh_cbef.protocol.runtimes import MOST_LINKS, ONE_RUNTIME, ROOMY_RUNTIMES, RUNTIME

OPENS = """
import os
from zenoh_cbef.protocol.session import Connection, open_session
open_session(Connection()).close()
print(os.environ["ZENOH_RUNTIME"])
"""


@pytest.mark.processes
@pytest.mark.parametrize(("given", "taken"), [(None, ROOMY_RUNTIMES), (ONE_RUNTIME, ONE_RUNTIME)])
def test_a_process_opens_its_first_session_with_room_for_all_its_links(given: str | None, taken: str) -> None:
    """Zenoh reads the variable, and panics at a value that it does not know."""
    environment = {name: value for name, value in os.environ.items() if name != RUNTIME}
    environment |= {} if given is None else {RUNTIME: given}
    told = subprocess.run([sys.executable, "-c", OPENS], env=environment, capture_output=True, text=True, check=True)
    assert told.stdout.strip() == taken


@pytest.mark.parametrize(("runtimes", "kept"), [(ROOMY_RUNTIMES, 5), (ONE_RUNTIME, 1)])
def test_every_runtime_that_is_kept_has_that_room(runtimes: str, kept: int) -> None:
    assert runtimes.count(f"max_blocking_threads:{MOST_LINKS}") == kept
    assert kept + runtimes.count("handover:app") == 5
