"""A target that is started again begins another run of the same name: nothing of the first one gets into it."""

import signal

from tests.processes.conftest import ended, settings


def test_processes_of_a_targets_earlier_run_end_and_leave_the_next_one_alone(world, endpoint):
    join = world.join(endpoint)
    place = ["--run", world.run, "--listen", endpoint]
    # Agents wait that long for their target: the next one may take its time to begin.
    patience = "timing.patience=100"
    first = world.start("target", "tracking", *settings("steps=300", patience), *place)

    def others(log: str) -> list:
        agents = [world.start("agent", str(agent), *join) for agent in range(4)]
        return [*agents, world.start("record", *join, "--output", log)]

    before = others("run.mcap")
    world.wait_for_messages()
    first.send_signal(signal.SIGKILL)
    first.wait()
    again = [world.start("target", "tracking", *settings("steps=60"), *place)]
    told = [process.communicate(timeout=100)[1] for process in before]
    assert before[-1].returncode == 0
    # An agent may have come to its own end a moment before.
    words = f"the target of run {world.run!r} was started again, so the run of agent"
    assert all(words in err for process, err in zip(before, told, strict=True) if process.returncode)
    assert any(words in err for err in told)
    again += others("again.mcap")
    for process in again:
        ended(process)
    for verb in ("check", "verify"):
        verdict = world.done(verb, "again.mcap")
    assert "60 steps" in verdict.stdout
