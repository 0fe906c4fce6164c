"""watch on a terminal: what it draws, how it is left, how it ends."""

import signal

import pytest

from tests.processes.conftest import COMMAND
from tests.terminal import Terminal


def drawn(character: str) -> bool:
    """Whether it is a part of a curve."""
    return "\u2800" < character <= "\u28ff"


@pytest.fixture
def watched(world):
    run = world.under_way("timing.mode=realtime", "dt=0.1", "steps=5000")
    terminal = Terminal([*COMMAND, "watch", "--run", world.run], folder=world.folder)
    words = ("position error, m", "disagreement, m", world.run, "started", "q quits")
    terminal.read_until(lambda seen: all(word in seen for word in words) and any(map(drawn, seen)))
    yield terminal, run
    terminal.close()


@pytest.mark.parametrize("how", ["q", "ctrl-c"])
def test_who_quits_leaves_the_run_alone(world, watched, how):
    terminal, run = watched
    terminal.write("q" if how == "q" else "\x03")
    assert terminal.leave() == 0
    assert run.poll() is None
    world.done("stop", "--run", world.run)


def test_the_end_of_the_run_ends_it(watched):
    terminal, run = watched
    run.send_signal(signal.SIGINT)
    assert terminal.leave() == 0
    assert "has ended after step" in terminal.seen
    run.communicate(timeout=100)


def test_without_a_terminal_it_says_what_to_use_instead(world):
    done = world.done("watch", "--run", world.run, status=2)
    assert "'status'" in done.stderr
