"""A name that is given twice."""

from tests.processes.conftest import World, settings


def test_the_second_run_of_a_name_has_another_one_everywhere(world: World):
    (world.folder / "logs" / "same").mkdir(parents=True)
    done = world.done("run", "tracking", *settings("steps=5"), "--run", "same", "--no-report")
    assert "note: logs/same exists; this run is 'same-2', for other verbs too\n" in done.stderr
    assert "same-2: " in done.stdout
    assert "same-2: " in world.call("analyze", "same-2").stdout
