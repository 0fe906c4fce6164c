"""A filter, a motion and a fault of another package: as processes, proved, in experiments, and refused where they are
others."""

import csv
import re
import shutil
import subprocess
import sys
from importlib import invalidate_caches
from operator import itemgetter
from pathlib import Path

import pytest

from tests.processes.conftest import World, ended, settings
from tests.processes.plugged import EXAMPLE, installed
from tests.waiting import until
from zenoh_cbef import plugins
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.trace import read_trace

MARK = r"cbef-example 0\.1\.0 sha256:[0-9a-f]{16}"
GAINS = ("filter.kind=fixed-gains", "filter.options.alpha=0.4")
HELIX = ("target.motion=helix", "target.options.rate=0.5")
FADING = ('fault=[{kind="fading", from=1.0, options={most=0.9}}]',)

EXPERIMENT = """
seeds = 2
[set]
steps = 20
"filter.kind" = "fixed-gains"
[[vary]]
key = "filter.options.alpha"
values = [0.2, 0.9]
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    return installed(tmp_path_factory.mktemp("example"))


@pytest.fixture
def plugged(site, monkeypatch):
    """The package can be imported here and in processes that begin now."""
    monkeypatch.syspath_prepend(site)
    monkeypatch.setenv("PYTHONPATH", str(site))
    yield site
    for name in [name for name in sys.modules if name.split(".")[0] == "cbef_example"]:
        del sys.modules[name]
    plugins.find.cache_clear()
    invalidate_caches()


@pytest.fixture
def changed(site, tmp_path) -> Path:
    """The same package on another host, with one line more."""
    copy = shutil.copytree(site, tmp_path / "changed")
    with (copy / "cbef_example" / "filters.py").open("a", encoding="utf-8") as stream:
        stream.write("# one line more\n")
    return copy


@pytest.mark.usefixtures("plugged")
def test_six_processes_run_it_and_their_log_is_proved(world: World):
    world.complete(*GAINS, *HELIX, *FADING, "agents.count=6")
    assert "equal bit for bit" in world.verdict()
    resolved = open_log(world.log).attachments["scenario.resolved.toml"].decode()
    assert len(re.findall(rf'^plugin = "{MARK}"$', resolved, re.MULTILINE)) == 3
    for options in ("alpha = 0.4\nbeta = 0.05\n", "[target.options]\nrate = 0.5\n", "period = 4.0\nmost = 0.9\n"):
        assert options in resolved
    trace = read_trace(world.log)
    assert trace.truth[-1, 2] - trace.truth[0, 2] == pytest.approx(0.5 * 0.1 * 39)
    assert 0 < trace.links.injected_lost.sum() == trace.links.lost.sum()


@pytest.mark.usefixtures("plugged")
@pytest.mark.parametrize(
    "case",
    [(GAINS, "filter", "fixed-gains"), (HELIX, "target", "helix"), (FADING, "fault", "fading")],
    ids=itemgetter(2),
)
def test_an_agent_that_has_another_one_is_refused_in_a_sentence(world, changed, monkeypatch, endpoint, case):
    named, key, name = case
    target = world.start("target", "tracking", *settings(*named), "--run", world.run, "--listen", endpoint)
    monkeypatch.setenv("PYTHONPATH", str(changed))
    agent = world.start("agent", "0", "--run", world.run, "--connect", endpoint, "--patience", "60")
    _, said = ended(agent, 2)
    assert "Traceback" not in said
    assert re.search(
        rf"{key}.\w+ = '{name}' is to be {MARK}, but on this host it is {MARK}; install the same package", said
    )
    monkeypatch.delenv("PYTHONPATH")
    without = world.start("agent", "0", "--run", world.run, "--connect", endpoint, "--patience", "60")
    _, said = ended(without, 2)
    assert re.search(rf"{key}.\w+ = '{name}' is of {MARK}, which is not on this host; install that package", said)
    assert target.poll() is None, "the target still waits for agents"


@pytest.mark.usefixtures("plugged")
def test_it_is_injected_with_options_into_a_run_that_goes_on(world):
    run = world.under_way("steps=100000")
    for most in (0.9, 0.5):
        world.done("fault", "add", "fading", f"options={{most={most}}}", "--run", world.run)
    until(lambda: "is on: fading" in world.call("status", "--run", world.run).stdout)
    world.done("stop", "--run", world.run)
    ended(run)


@pytest.mark.usefixtures("plugged")
def test_an_experiment_varies_its_options(world):
    (world.folder / "gains.toml").write_text(EXPERIMENT)
    world.done("experiment", "gains.toml", "-o", "out", "--jobs", "1")
    with (world.folder / "out" / "results.csv").open() as stream:
        found = {row["filter.options.alpha"]: row["position_rmse"] for row in csv.DictReader(stream)}
    assert found.keys() == {"0.2", "0.9"}
    assert found["0.2"] != found["0.9"]


@pytest.mark.usefixtures("plugged")
def test_the_example_keeps_its_own_tests(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", EXAMPLE / "tests"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    assert done.returncode == 0, done.stdout
