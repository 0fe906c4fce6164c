"""watch on a terminal: what it draws, how it is left, how it ends."""

import fcntl
import os
import pty
import select
import signal
import struct
import subprocess
import termios
import time
from collections.abc import Callable

import pytest

from tests.processes.conftest import COMMAND
from tests.processes.test_live_faults import wait_until_known


class Terminal:
    """A terminal of 40 lines, and what a program has written on it."""

    def __init__(self, world, *command: str) -> None:
        self.leader, follower = pty.openpty()
        fcntl.ioctl(follower, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 120, 0, 0))
        self.process = subprocess.Popen(
            [*COMMAND, *command],
            cwd=world.folder,
            stdin=follower,
            stdout=follower,
            stderr=follower,
            env=os.environ | {"TERM": "xterm"},
            preexec_fn=lambda: (os.setsid(), fcntl.ioctl(follower, termios.TIOCSCTTY, 0)),  # noqa: PLW1509
        )
        os.close(follower)
        self._raw, self.seen = b"", ""

    def read_until(self, condition: Callable[[str], bool]) -> None:
        """Read until what was written fulfils a condition, or the program ends."""
        until = time.monotonic() + 60
        while not condition(self.seen):
            assert time.monotonic() < until, self.seen
            if select.select([self.leader], [], [], 0.2)[0]:
                try:
                    self._raw += os.read(self.leader, 65536)
                except OSError:  # the program was its last user
                    return
                self.seen = self._raw.decode(errors="replace")

    def leave(self) -> int:
        self.read_until(lambda _seen: False)
        return self.process.wait(timeout=30)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        os.close(self.leader)


def drawn(character: str) -> bool:
    """Whether it is a part of a curve."""
    return "\u2800" < character <= "\u28ff"


@pytest.fixture
def watched(world):
    run = world.start_run("timing.mode=realtime", "dt=0.1", "steps=5000")
    wait_until_known(world.run)
    world.wait_for_messages()
    terminal = Terminal(world, "watch", "--run", world.run)
    words = ("position error, m", "disagreement, m", world.run, "started", "q quits")
    terminal.read_until(lambda seen: all(word in seen for word in words) and any(map(drawn, seen)))
    yield terminal, run
    terminal.close()


@pytest.mark.parametrize("how", ["q", "ctrl-c"])
def test_who_quits_leaves_the_run_alone(world, watched, how):
    terminal, run = watched
    os.write(terminal.leader, b"q" if how == "q" else b"\x03")
    assert terminal.leave() == 0
    assert run.poll() is None
    assert world.call("stop", "--run", world.run).returncode == 0


def test_the_end_of_the_run_ends_it(watched):
    terminal, run = watched
    run.send_signal(signal.SIGINT)
    assert terminal.leave() == 0
    assert "has ended after step" in terminal.seen
    run.communicate(timeout=60)


def test_without_a_terminal_it_says_what_to_use_instead(world):
    done = world.call("watch", "--run", world.run)
    assert done.returncode == 2
    assert "'status'" in done.stderr
