"""watch on a terminal: what it draws, how it is left, how it ends."""

import re
import signal

import pytest

from tests.processes.conftest import COMMAND, settings
from tests.terminal import Terminal


def drawn(character: str) -> bool:
    """Whether it is a part of a curve."""
    return "\u2800" < character <= "\u28ff"


@pytest.fixture
def watched(world):
    run = world.under_way("timing.mode=realtime", "dt=0.5", "steps=5000")
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


def test_target_agent_and_recorder_say_on_a_terminal_what_they_wait_for_and_how_far_they_are(world, free_port):
    endpoint = f"tcp/127.0.0.1:{free_port}"
    keys = settings("steps=100000", "agents.count=3", "timing.mode=realtime", "network.graph=complete")

    def begun(verb: str, *more: str) -> Terminal:
        return Terminal([*COMMAND, verb, *more, "--run", world.run], folder=world.folder, width=60)

    with begun("target", "tracking", *keys, "--listen", endpoint) as target:
        target.read_until(lambda seen: "\rwaiting for agent 0, agent 1, agent 2" in seen)
        there = ("--connect", endpoint)
        with begun("record", *there, "-o", "run.mcap") as recorder, begun("agent", "0", *there) as agent:
            agent.read_until(lambda seen: f"agent 0 is in run {world.run}, and waits for the others" in seen)
            target.read_until(lambda seen: "\rwaiting for agent 1 and agent 2\033[K" in seen)
            with begun("agent", "1", *there), begun("agent", "2", *there):
                agent.read_until(lambda seen: "agent 0 is under way" in seen)
                for one in (target, recorder):
                    one.read_until(lambda seen: re.search(r"\rstep \d+ of 100000", seen) is not None)
                target.write("\x03")
                assert target.leave() in {0, 130}
                assert recorder.leave() == 0
        assert re.search(r"\r\033\[K\d+ messages in run.mcap", recorder.seen)


def test_without_a_terminal_it_says_what_to_use_instead(world):
    done = world.done("watch", "--run", world.run, status=2)
    assert "'status'" in done.stderr
