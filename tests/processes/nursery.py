"""The nursery of tests: what it forks may be on a virtual host, which it enters before it is anything else.

A process is on a host by its network namespace. As with `ip netns exec`, but begun in a hundredth of the time.
"""

import ctypes
import os
import sys
from typing import NoReturn

from zenoh_cbef.nodes.launch import nursery

NAME = "tests.processes.nursery"
SPACE = "TEST_SPACE"
"""The environment variable that names the file of a network namespace."""
_NETWORK = 0x40000000  # CLONE_NEWNET
_become = nursery.become


def become(streams: list[int], command: list[str], environment: dict[str, str], folder: str) -> NoReturn:
    """Be the process of a command line, on its host."""
    if space := environment.pop(SPACE, ""):
        file = os.open(space, os.O_RDONLY)
        if ctypes.CDLL(None, use_errno=True).setns(file, _NETWORK):
            raise OSError(ctypes.get_errno(), f"cannot enter {space}")
        os.close(file)
    _become(streams, command, environment, folder)


if __name__ == "__main__":
    nursery.become = become
    nursery.main(sys.argv[2:])
