"""Plug-ins that can be imported, and do wrong in a run: one sentence has the class, its line, and what it did."""

import sys
from pathlib import Path

import pytest

from zenoh_cbef import plugins
from zenoh_cbef.analysis.divergence import refuse_divergence
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.testing.faults import refuse_broken

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "plugin"
FILTER, MOTION, FAULT = "filter.kind=wrong:Mine", "target.motion=wrong:Mine", 'fault=[{kind="wrong:Mine"}]'
SENSOR, SENDER = 'fault=[{ kind="wrong:Mine"}]', 'fault=[{kind="wrong:Mine", agents=[2]}]'
CLASSES = {
    FILTER: "cbef_example.filters import FixedGains",
    MOTION: "cbef_example.motions import Helix",
    FAULT: "cbef_example.faults import Fading",
    SENSOR: "zenoh_cbef.extending import SensorFault",
    SENDER: "zenoh_cbef.extending import SenderFault",
}


@pytest.fixture
def written(monkeypatch, tmp_path):
    """Writes the module `wrong`, with a class Mine, onto the path."""
    monkeypatch.syspath_prepend(EXAMPLE)
    monkeypatch.syspath_prepend(tmp_path)
    yield lambda head, text: (tmp_path / "wrong.py").write_text(f"{head}class Mine(Example):\n{text}")
    plugins.find.cache_clear()
    for name in [name for name in sys.modules if name.split(".")[0] in {"wrong", "cbef_example"}]:
        del sys.modules[name]


@pytest.mark.parametrize(
    ("method", "body", "case"),
    [
        ("update(self, belief, measurement)", "1 / 0", (FILTER, r"update.* at \S+wrong.py:5 \(ZeroDivisionError: div")),
        ("update(self, belief)", "1", (FILTER, r"update.* at \S+wrong.py:4 \(TypeError: .*positional")),
        ("update(self, belief, measurement)", "[]", (FILTER, r"update\(\) gives a list; return an Update")),
        (
            "conclude(self, payload, update)",
            "payload",
            (FILTER, r"conclude\(\) gives float64 \(6, 6\); return a Belief"),
        ),
        ("conclude(self, payload, update)", "{}['a']", (FILTER, r"conclude.* at \S+wrong.py:5 \(KeyError: 'a'\)")),
        (
            "conclude(self, payload, update)",
            "Belief(payload[:, :3], None)",
            (FILTER, r"state is float64 \(6, 3\), not"),
        ),
        (
            "states(self, time)",
            "time",
            (MOTION, r"states.* at \S+wrong.py:4 \(TypeError: .*gives \(21,\), not \(21, 6\)"),
        ),
        (
            "states(self, time)",
            "np.full((len(time), 6), np.nan)",
            (MOTION, r"states.* at \S+wrong.py:4 \(FloatingPointError: a state is not finite at 0 s\)"),
        ),
        ("effect(self, messages, index)", "messages.no", (FAULT, r"effect.* at \S+wrong.py:5 \(AttributeError: ")),
        (
            "effect(self, messages, index)",
            "Effect(lost=1.0 * messages.source)",
            (FAULT, r"effect.* at \S+wrong.py:4 \(TypeError: effect\(\).lost is float64 \(22,\), not bool \(22,\)"),
        ),
        (
            "effect(self, messages, index)",
            "Effect(lost=messages.source[:1] > 0)",
            (FAULT, r"effect\(\).lost is bool \(1,\), not bool \(22,\)"),
        ),
        ("effect(self, messages, index)", "None", (FAULT, r"effect\(\) gives no Effect; return one")),
        ("selects(self, source, _)", "source[:1] > 0", (FAULT, r"selects\(\) is bool \(1,\), not bool")),
        (
            "measured(self, readings, index)",
            "readings.ranges[0]",
            (SENSOR, r"no float64 array \(6, 20\); return a range"),
        ),
        ("sent(self, honest, index)", "honest.message[:, :1]", (SENDER, r"sent\(\) gives no float64 array \(1, ")),
        ("sent(self, honest, index)", "honest.message / 0", (SENDER, r"sent\(\) gives a number that is not finite")),
    ],
)
def test_what_a_plugin_does_wrong_is_told_with_its_line(written, case, method, body):
    setting, said = case
    head = f"import numpy as np; from zenoh_cbef.extending import Belief, Effect\nfrom {CLASSES[setting]} as Example\n"
    written(head, f"    def {method}:\n        return {body}\n")
    with pytest.raises(UserError, match=rf"Mine\..*{said}.*; correct it: zenoh_cbef\.testing\.check_\w+ tells more"):
        simulate([load("tracking", ["steps=20", setting]).scenario])


@pytest.mark.parametrize(
    ("case", "method", "body", "said"),
    [
        (FAULT, "effect(self, messages, index)", "None", r"effect\(\) gives no Effect"),
        (FAULT, "effect(self, messages, index)", "1 / 0", r"wrong.py:4 \(ZeroDivisionError"),
        (SENDER, "sent(self, honest, index)", "honest.message[:, :1]", r"sent\(\) gives no float64"),
        (SENSOR, "measured(self, readings, index)", "readings.ranges[0]", "no float64 array"),
    ],
)
def test_a_fault_that_does_wrong_is_not_injected(written, case, method, body, said):
    written(f"from {CLASSES[case]} as Example\n", f"    def {method}:\n        return {body}\n")
    with pytest.raises(
        UserError, match=rf"Mine\.{method.partition('(')[0]}\(\) fails at .*{said}.*check_fault tells more"
    ):
        refuse_broken("wrong:Mine", {"kind": "wrong:Mine", "from": 3.0})
    for name, key in (("wrong:Mine", "no"), ("wrong:Yours", "links"), ("loss", "probability")):
        refuse_broken(name, {"kind": name, key: 2})


def test_a_filter_that_gives_no_finite_numbers_is_named(written):
    written(
        f"import numpy as np\nfrom zenoh_cbef.extending import Belief\nfrom {CLASSES[FILTER]} as Example\n",
        "    def conclude(self, payload, update):\n        return Belief(payload * np.nan, None)\n",
    )
    [trace] = simulate([load("tracking", ["steps=20", FILTER]).scenario])
    with pytest.raises(
        UserError, match=r"the filter 'wrong:Mine' diverges or has a mistake: .*check_filter tells more"
    ):
        refuse_divergence(trace)
