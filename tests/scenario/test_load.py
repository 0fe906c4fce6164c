"""Scenarios come from built-ins and files, take overrides, and go back to TOML unchanged."""

from __future__ import annotations

import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zenoh_cbef.errors import UserError
from zenoh_cbef.faults.delay import Delay
from zenoh_cbef.faults.loss import Loss
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import builtin_names, load, parse, read_source, to_toml, value_of


def test_the_promised_scenarios_are_built_in():
    assert set(builtin_names()) >= {"tracking", "paper", "scale24", "outliers"}


@pytest.mark.parametrize("name", builtin_names())
def test_built_in_scenarios_load_and_check(name):
    loaded = load(name)
    check(loaded.plan)
    assert loaded.scenario.name == name
    assert loaded.source == read_source(name)[0]
    assert parse(tomllib.loads(to_toml(loaded.scenario)), name) == loaded.scenario


def test_a_resolved_scenario_names_its_steps():
    assert load("tracking", ["steps=17"]).scenario.steps == 17
    assert load("tracking").scenario.steps == load("tracking").scenario.length


def test_overrides_are_toml_values_or_plain_text():
    scenario = load(
        "tracking",
        [
            "consensus.rounds=5",
            "network.graph=ring",
            'filter.kind="icf"',
            "agents.positions=[[0,0,0],[1,0,0],[2,0,0]]",
            "agents.count=3",
            "record.required=false",
            " sensor.range_std = 2",
            "fault=[{kind='loss', probability=0.25}]",
        ],
    ).scenario
    assert scenario.consensus.rounds == 5
    assert scenario.network.graph == "ring"
    assert scenario.filter.kind == "icf"
    assert scenario.agents.positions == ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0))
    assert scenario.record.required is False
    assert scenario.sensor.range_std == 2.0
    assert type(scenario.sensor.range_std) is float
    assert isinstance(scenario.fault[0], Loss)
    assert scenario.fault[0].probability == 0.25


def test_the_last_of_two_overrides_counts():
    assert load("tracking", ["seed=1", "seed=2"]).scenario.seed == 2


def test_a_file_is_read_and_kept_as_it_was_written(tmp_path):
    path = tmp_path / "mine.toml"
    text = '# mine\nname = "mine"\nsteps = 12\n[agents]\ncount = 3\n'
    path.write_text(text)
    loaded = load(str(path), ["seed=5"])
    assert (loaded.scenario.name, loaded.scenario.steps, loaded.scenario.seed) == ("mine", 12, 5)
    assert loaded.source == text
    assert read_source(str(path)) == (text, tmp_path.resolve())


def test_a_byte_order_mark_does_not_matter(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xef\xbb\xbfsteps = 12\n")
    assert load(str(path)).scenario.steps == 12


def test_an_unknown_name_suggests_the_nearest():
    with pytest.raises(UserError, match="did you mean 'tracking'"):
        load("trackin")
    with pytest.raises(UserError, match="scenario list"):
        load("nothing-like-it.toml")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"steps = \n", "is not valid TOML: .*correct that line"),
        (b"\xff\xfe\x00", "is not UTF-8 text"),
        (b"steps = " + b"9" * 5000, "is not valid TOML"),
        (b"x = " + b"[" * 5000, "is not valid TOML"),
        (b"seed = 0x" + b"9" * 5000, "too many digits"),
    ],
)
def test_a_file_that_is_no_scenario_is_refused(tmp_path, content, said):
    path = tmp_path / "bad.toml"
    path.write_bytes(content)
    with pytest.raises(UserError, match=said) as caught:
        load(str(path))
    assert str(path) in str(caught.value)


NUMBERS = st.floats(-1e6, 1e6)
POSITIVE = st.floats(1e-6, 1e6)
VECTORS = st.lists(NUMBERS, min_size=3, max_size=3)
FAULTS = st.one_of(
    st.fixed_dictionaries(
        {"kind": st.just("loss"), "probability": st.floats(0, 1)},
        optional={"from": st.floats(0, 10), "until": st.floats(11, 20), "links": st.just("agent:1")},
    ),
    st.fixed_dictionaries(
        {"kind": st.just("delay"), "milliseconds": st.floats(0, 100)},
        optional={"jitter_ms": st.floats(0, 5), "links": st.just([[0, 1], [1, 0]])},
    ),
)
SCENARIOS = st.fixed_dictionaries(
    {},
    optional={
        "name": st.from_regex(r"[A-Za-z0-9][A-Za-z0-9._-]{0,20}", fullmatch=True),
        "seed": st.integers(0, 2**64 - 1),
        "steps": st.integers(1, 10_000_000),
        "dt": POSITIVE,
        "target": st.fixed_dictionaries({}, optional={"position": VECTORS, "acceleration_std": POSITIVE}),
        "agents": st.fixed_dictionaries(
            {},
            optional={
                "low": st.one_of(NUMBERS, VECTORS),
                "positions": st.lists(VECTORS, min_size=6, max_size=6),
            },
        ),
        "sensor": st.fixed_dictionaries(
            {},
            optional={
                "bias": st.one_of(NUMBERS, st.lists(NUMBERS, min_size=6, max_size=6)),
                "range_std": POSITIVE,
            },
        ),
        "network": st.fixed_dictionaries({}, optional={"edges": st.lists(st.just([0, 1]), max_size=3)}),
        "filter": st.fixed_dictionaries(
            {},
            optional={
                "kind": st.sampled_from(["sicf", "icf", "cbef", "local"]),
                "planar_height": NUMBERS,
                "initial_position": st.one_of(VECTORS, st.lists(VECTORS, min_size=6, max_size=6)),
            },
        ),
        "fault": st.lists(FAULTS, max_size=3),
        "zenoh": st.fixed_dictionaries({}, optional={"connect": st.lists(st.text(max_size=20), max_size=2)}),
    },
)


@pytest.mark.slow
@settings(deadline=None)
@given(SCENARIOS)
def test_a_scenario_written_as_toml_is_read_back_equal(data):
    scenario = parse(data, "drawn")
    assert parse(tomllib.loads(to_toml(scenario)), "again") == scenario


def test_an_empty_scenario_is_the_default_one():
    assert parse({}, "empty") == Scenario()


def test_an_override_reaches_a_fault_by_its_place_or_kind():
    faults = 'fault=[{kind="loss", probability=0.1}, {kind="delay", milliseconds=3.0}]'
    loaded = load("tracking", [faults, "fault.0.probability=0.2", "fault.delay.milliseconds=4.0"]).scenario
    loss, delay = loaded.fault
    assert isinstance(loss, Loss)
    assert isinstance(delay, Delay)
    assert (loss.probability, delay.milliseconds) == (0.2, 4.0)


@pytest.mark.parametrize(("text", "value"), [(".3", 0.3), ("-.3", -0.3), ("5.", 5.0), (".5e-3", 5e-4), ("3", 3)])
def test_numbers_may_be_written_short(text, value):
    assert value_of(text) == value


@pytest.mark.parametrize("text", [".", "", "..3", ".3.4", "-", "e5"])
def test_what_only_resembles_a_number_is_text(text):
    assert value_of(text) == text


@pytest.mark.parametrize("text", ["[{kind='loss', probability=.1}]", "{a=}", '"open', " [1, loss]"])
def test_a_list_table_or_quoted_text_that_is_no_toml_is_refused_as_such(text):
    with pytest.raises(UserError, match=r"--set .*: the value is not valid TOML: .*; write 0\.1, not \.1"):
        load("tracking", [f"fault={text}"])


def test_an_entry_of_an_empty_list_is_told_to_be_given_as_a_whole():
    with pytest.raises(UserError, match=r"there is no entry 0, as the list is empty; give the whole list"):
        load("tracking", ["fault.0.probability=0.5"])


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("fault.2.probability", "there is no entry 2; there is 0 (loss), 1 (loss)"),
        ("fault.loss.probability", "2 entries are of the kind loss"),
        ("fault.0.probability.x", "fault.0.probability is not a table"),
    ],
)
def test_an_override_of_a_fault_that_is_not_there_says_which_are(key, words):
    faults = 'fault=[{kind="loss", probability=0.1}, {kind="loss", probability=0.2}]'
    with pytest.raises(UserError) as refused:
        load("tracking", [faults, f"{key}=0.2"])
    assert words in str(refused.value)


def test_a_folder_is_told_as_that_with_the_file_in_it(tmp_path):
    (tmp_path / "other.toml").write_text("")
    for name in ("other.toml", "scenario.toml"):
        (tmp_path / name).write_text("")
        with pytest.raises(UserError, match=rf"is a folder; did you mean '.*{name}'\?"):
            load(str(tmp_path))
