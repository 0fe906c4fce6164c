"""Classes of other packages in a scenario: found, told apart, and refused in a sentence."""

import re
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from pydantic import BaseModel

from tests.log.made import made_log
from zenoh_cbef import plugins
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.prove.reestimate import reestimate
from zenoh_cbef.log.prove.verify import verify
from zenoh_cbef.log.read.measurements import read_measurements
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.tools.check import check
from zenoh_cbef.plain import Json
from zenoh_cbef.plugins import told_options
from zenoh_cbef.scenario.injected import STEER, marked, with_faults
from zenoh_cbef.scenario.load import load, parse, to_toml, value_of
from zenoh_cbef.simulator import simulate

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "plugin"
SHORT = "steps=20"
MINE = """from cbef_example.faults import Fading as Fading
from cbef_example.filters import FixedGains as Gains
from cbef_example.motions import Helix as Helix
"""


@pytest.fixture
def plugged(monkeypatch, tmp_path):
    """A module `mine` on the path, of no package, and the example, which is not installed."""
    monkeypatch.syspath_prepend(EXAMPLE)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "mine.py").write_text(MINE)
    (tmp_path / "broken.py").write_text("import no_such_module_of_ours\n")
    (tmp_path / "leaving.py").write_text("raise SystemExit(3)\n")
    (tmp_path / "failing.py").write_text("raise AssertionError('no data')\n")
    yield tmp_path
    for name in [name for name in sys.modules if name.split(".")[0] in {"cbef_example", "mine", "broken"}]:
        del sys.modules[name]
    plugins.find.cache_clear()


@pytest.mark.usefixtures("plugged")
def test_a_class_is_named_by_its_module_and_its_options_are_its_own():
    lazy, eager = (
        simulate([load("tracking", [SHORT, "filter.kind=mine:Gains", f"filter.options.alpha={alpha}"]).scenario])[0]
        for alpha in (0.01, 0.5)
    )
    error = [np.linalg.norm((one.estimates - one.truth)[:, -1, :3], axis=1).mean() for one in (lazy, eager)]
    assert error[1] < error[0]


@pytest.mark.usefixtures("plugged")
def test_a_scenario_says_what_its_plugin_is_with_all_options():
    text = to_toml(load("tracking", [SHORT, "filter.kind=mine:Gains"]).scenario)
    assert 'plugin = "mine sha256:' in text
    assert "[filter.options]\nalpha = 0.5\nbeta = 0.05\n" in text
    assert "period = 4.0\nmost = 0.8\n" in to_toml(load("tracking", [SHORT, "fault=[{kind='mine:Fading'}]"]).scenario)
    assert "plugin" not in to_toml(load("tracking").scenario)


@pytest.mark.usefixtures("plugged")
@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("filter.kind=gone:Mine", "filter.kind names module 'gone', which is not installed on this host; install"),
        ("filter.kind=mine.filters:Mine", "names module 'mine.filters', which is not installed"),
        ("filter.kind=broken:Mine", r"'broken', which cannot be imported \(ModuleNotFoundError: No module"),
        ("filter.kind=leaving:Mine", r"'leaving', which cannot be imported \(SystemExit: 3\); correct it"),
        ("filter.kind=failing:Mine", r"'failing', which cannot be imported \(AssertionError: no data\); correct it"),
        ("filter.kind=mine:Gain", "names 'Gain', but module 'mine' has no class of that name; did you mean 'Gains'"),
        ("filter.kind=cbef_example.filters:Gains", r"is no filter: it lacks of\(\), sharing\(\), update\(\)"),
        ("filter.kind=os:PathLike", "module 'os' of Python itself"),
        ("filter.kind=numpy:ndarray", "package numpy does not require zenoh-cbef, so it is no plug-in"),
        ("filter.kind=zenoh_cbef.simulator:Simulation", "so it is no plug-in"),
        ("filter.kind=sicff", "must be one of sicf, .*, or 'package.module:Class', not 'sicff'"),
        ("filter.options.alpha=1", "filter.options has alpha, but 'sicf' has no options"),
        ("filter.options=1", "filter.options must be a table of options, not 1"),
        ("filter.plugin=mine", "'sicf' is of no other package, but is to be of mine"),
        ("target.motion=mine:Gains", r"target.motion names 'mine:Gains', which is no motion: it lacks states\(\)"),
        ("target.motion=hop", "target.motion must be one of ncv, .*, dataset, or 'package.module:Class', not 'hop'"),
        ("target.options.rate=1", "target.options has rate, but 'ncv' has no options"),
        ("target.plugin=mine", "target.motion = 'ncv' is of no other package"),
        (
            "fault=[{kind='mine:Helix'}]",
            r"fault\[0\].kind names 'mine:Helix', which is no fault: derive it",
        ),
        ("fault=[{kind='los'}]", r"fault\[0\].kind must be one of loss, .*, or 'package.module:Class', not 'los'"),
        ("fault=[{kind='pause', agents=[1], until=1.0, plugin='mine'}]", "fault.kind = 'pause' is of no other package"),
        ("fault=[{kind='mine:Fading', links=3}]", r"fault\[0\].links must be 'all', 'agent:3', pairs"),
        ("fault=[{kind='mine:Fading', most=1.0}]", "write it as fault.options.most"),
        ("fault=[{kind='mine:Fading', options=3}]", r"fault\[0\].options must be a table of keys, not 3"),
        (
            "fault=[{kind='mine:Fading', options={most=2.0}}]",
            "fault.options.most: the value should be less than",
        ),
        (
            "fault=[{kind='mine:Fading', plugin='mine 3'}]",
            "fault.kind = 'mine:Fading' is to be mine 3, but on this host",
        ),
    ],
)
def test_what_is_no_plugin_is_refused_in_a_sentence(setting, said):
    with pytest.raises(UserError, match=said):
        load("tracking", [setting])


@pytest.mark.usefixtures("plugged")
@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("filter.options.alpha=7", "filter.options.alpha: the value should be less than or equal to 1, not 7"),
        ("filter.options.alpa=0.1", "filter.options.alpa is no option of Gains; did you mean 'alpha'?"),
        ("filter.plugin=mine 3", "is to be mine 3, but on this host it is mine sha256:.*; install the same package"),
    ],
)
def test_bad_options_and_other_versions_are_refused_in_a_sentence(setting, said):
    with pytest.raises(UserError, match=said):
        load("tracking", ["filter.kind=mine:Gains", setting])


class Chosen(BaseModel):
    name: str = "a"


@pytest.mark.parametrize("written", ["nan", "inf", "3", "true"])
def test_text_that_is_not_in_quotes_is_told_how_to_quote_it(written):
    given = value_of(written)
    with pytest.raises(ValueError, match=r"filter.options.name is text, not .*; put it in quotes") as caught:
        told_options(Chosen, "mine", {"name": given}, "filter.options")
    [_, remedy, _] = str(caught.value).split("'")
    key, _, value = remedy.partition("=")
    assert (key, value_of(value)) == ("filter.options.name", written)


def test_a_stranger_cannot_have_code_imported_that_is_no_plugin(plugged):
    (plugged / "stranger").mkdir()
    (plugged / "stranger" / "__init__.py").write_text("raise SystemExit('imported')\n")
    info = plugged / "stranger-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\nRequires-Dist: numpy\n")
    with pytest.raises(UserError, match="package stranger does not require zenoh-cbef"):
        load("tracking", ["filter.kind=stranger:Mine"])


def test_a_log_of_another_source_is_not_proved_but_read_and_estimated_again(plugged):
    log = made_log(plugged / "run.mcap", SHORT, "filter.kind=mine:Gains", "filter.options.alpha=0.3")
    assert verify(log).result == "equal"
    (plugged / "mine.py").write_text(MINE + "# changed\n")
    plugins.find.cache_clear()
    with pytest.raises(UserError, match=r"is to be mine sha256:.*, but on this host it is mine sha256:"):
        verify(log)
    found = read_measurements(log)
    for name, overrides in (("again", ["filter.options.alpha=0.2"]), ("other", ["filter.kind=sicf"])):
        loaded = found.loaded(overrides)
        reestimate(found, loaded, name, plugged / f"{name}.mcap")
        assert verify(plugged / f"{name}.mcap").result == "equal"
    assert b"alpha = 0.2" in open_log(plugged / "again.mcap").attachments["scenario.resolved.toml"]


HELIX, FADING = "target.motion=mine:Helix", "fault=[{kind='mine:Fading', options={most=0.9}}]"


@pytest.mark.usefixtures("plugged")
def test_a_motion_and_a_fault_run_are_stamped_and_travel():
    loaded = load("tracking", [SHORT, HELIX, "target.options.rate=0.5", FADING])
    [trace] = simulate([loaded.scenario])
    assert np.allclose(trace.truth[:, 5], 0.5)
    assert 0 < trace.links.injected_lost.sum() == trace.links.lost.sum()
    text = to_toml(loaded.scenario)
    assert text.count('plugin = "mine sha256:') == 2
    assert "[target.options]\nrate = 0.5\n" in text
    assert "period = 4.0\nmost = 0.9\n" in text
    assert parse(tomllib.loads(text), "again") == loaded.scenario


def test_a_log_with_a_motion_and_a_fault_of_another_source_is_not_proved_but_estimated_again(plugged):
    log = made_log(plugged / "run.mcap", SHORT, HELIX, FADING)
    assert verify(log).result == "equal"
    (plugged / "mine.py").write_text(MINE + "# changed\n")
    plugins.find.cache_clear()
    with pytest.raises(UserError, match=r"target.motion = 'mine:Helix' is to be mine sha256:"):
        verify(log)
    found = read_measurements(log)
    reestimate(found, found.loaded(["filter.kind=icf"]), "again", plugged / "again.mcap")
    assert verify(plugged / "again.mcap").result == "equal"


@pytest.mark.parametrize(
    ("setting", "key"), [(HELIX, "target.motion"), (FADING, "fault.kind"), ("filter.kind=mine:Gains", "filter.kind")]
)
def test_a_log_whose_package_is_not_on_this_host_names_it(plugged, setting, key):
    log = made_log(plugged / "run.mcap", SHORT, setting)
    (plugged / "mine.py").unlink()
    del sys.modules["mine"]
    plugins.find.cache_clear()
    said = f"{key} = 'mine:.*' is of mine sha256:[0-9a-f]+, which is not on this host; install that package here, too$"
    with pytest.raises(UserError, match=said):
        verify(log)
    found = check(open_log(log))
    assert re.search(said, found.unread)
    assert (found.exit_status, found.messages > 0, found.damage) == (2, True, [])
    log.write_bytes(log.read_bytes()[:-2000])
    assert check(open_log(log)).exit_status == 1


@pytest.mark.usefixtures("plugged")
def test_an_injected_fault_travels_with_what_it_is():
    plan = load("tracking", [SHORT]).plan
    tables: list[dict[str, Json]] = [
        {"kind": STEER},
        {"kind": "mine:Fading", "from": 1.0},
        {"kind": "outage", "agents": [1]},
    ]
    extended = with_faults(plan, tables[1:])
    steer, fading, cut = marked(extended, tables)
    assert str(fading["plugin"]).startswith("mine sha256:")
    assert "plugin" not in {**steer, **cut}
    with pytest.raises(UserError, match="'mine:Fading' is to be other 1, but on this host"):
        with_faults(plan, [fading | {"plugin": "other 1"}])
