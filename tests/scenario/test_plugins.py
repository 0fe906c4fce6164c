"""Classes of other packages in a scenario: found, told apart, and refused in a sentence."""

import sys
from pathlib import Path

import numpy as np
import pytest

from tests.log.made import made_log
from zenoh_cbef import plugins
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.prove.reestimate import reestimate
from zenoh_cbef.log.prove.verify import verify
from zenoh_cbef.log.read.measurements import read_measurements
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.scenario.load import load, to_toml
from zenoh_cbef.simulator import simulate

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "plugin"
SHORT = "steps=20"


@pytest.fixture
def plugged(monkeypatch, tmp_path):
    """A module `mine` on the path, of no package, and the example, which is not installed."""
    monkeypatch.syspath_prepend(EXAMPLE)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "mine.py").write_text("from cbef_example.filters import FixedGains as Gains\n")
    (tmp_path / "broken.py").write_text("import no_such_module_of_ours\n")
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
    assert "plugin" not in to_toml(load("tracking").scenario)


@pytest.mark.usefixtures("plugged")
@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("filter.kind=gone:Mine", "filter.kind names module 'gone', which is not installed on this host; install"),
        ("filter.kind=mine.filters:Mine", "names module 'mine.filters', which is not installed"),
        ("filter.kind=broken:Mine", r"'broken', which cannot be imported \(ModuleNotFoundError: No module"),
        ("filter.kind=mine:Gain", "names 'Gain', but module 'mine' has no class of that name; did you mean 'Gains'"),
        ("filter.kind=cbef_example.filters:Gains", r"is no filter: it lacks of\(\), sharing\(\), update\(\)"),
        ("filter.kind=os:PathLike", "module 'os' of Python itself"),
        ("filter.kind=numpy:ndarray", "package numpy does not require zenoh-cbef, so it is no plug-in"),
        ("filter.kind=zenoh_cbef.simulator:Simulation", "so it is no plug-in"),
        ("filter.kind=sicff", "must be one of sicf, .*, or 'package.module:Class', not 'sicff'"),
        ("filter.options.alpha=1", "filter.options has alpha, but 'sicf' has no options"),
        ("filter.options=1", "filter.options must be a table of options, not 1"),
        ("filter.plugin=mine", "'sicf' is of no other package, but is to be of mine"),
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
    (plugged / "mine.py").write_text("from cbef_example.filters import FixedGains as Gains  # changed\n")
    plugins.find.cache_clear()
    with pytest.raises(UserError, match=r"is to be mine sha256:.*, but on this host it is mine sha256:"):
        verify(log)
    found = read_measurements(log)
    for name, overrides in (("again", ["filter.options.alpha=0.2"]), ("other", ["filter.kind=sicf"])):
        loaded = found.loaded(overrides)
        reestimate(found, loaded, name, plugged / f"{name}.mcap")
        assert verify(plugged / f"{name}.mcap").result == "equal"
    assert b"alpha = 0.2" in open_log(plugged / "again.mcap").attachments["scenario.resolved.toml"]
