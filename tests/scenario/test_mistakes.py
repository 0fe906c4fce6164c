"""Every mistake in a scenario is one sentence that names file, key and remedy."""

# ruff: noqa: E501 - a sentence and what provokes it stand side by side

from __future__ import annotations

import tomllib

import pytest

from zenoh_cbef.errors import UserError
from zenoh_cbef.faults import KINDS as KINDS_OF_FAULTS
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking.filters import KINDS

UNKNOWN = "is not a key of a scenario"
FAULTS = ", ".join(KINDS_OF_FAULTS)

REFUSED = {
    'steps = "300"': "steps must be a whole number, not '300'",
    "target.orders = [{from = 3}]": "target.orders[0].to is missing; add it",
    "steps = true": "steps must be a whole number, not true",
    "steps = 3.0": "steps must be a whole number, not 3.0",
    "steps = 0": "steps must be greater than or equal to 1, not 0",
    'dt = "0.1"': "dt must be a number from 1e-06 to 1000000, not '0.1'",
    "dt = nan": "dt must be a finite number, not nan",
    "dt = -inf": "dt must be a finite number, not -inf",
    "dt = true": "dt must be a number from 1e-06 to 1000000, not true",
    "dt = 0": "dt must be a number from 1e-06 to 1000000, not 0",
    "dt = 1e400": "dt must be a finite number, not inf",
    "seed = -1": "seed must be greater than or equal to 0, not -1",
    "seed = 18446744073709551616": "seed must be less than 18446744073709551616",
    "name = 3": "name must be at most 100 letters, digits",
    'name = "a/b"': "name must be at most 100 letters, digits",
    'name = ""': "name must be at most 100 letters, digits",
    "name = 2024-01-01": "name must be at most 100 letters, digits",
    "seeed = 3": f"seeed {UNKNOWN}; did you mean 'seed'?",
    "zzz = 3": f"zzz {UNKNOWN}; remove it, or see",
    "conensus.rounds = 1": f"conensus {UNKNOWN}; did you mean 'consensus'?",
    "consensus.round = 3": f"consensus.round {UNKNOWN}; did you mean 'consensus.rounds'?",
    "target.postion = [0, 0, 0]": f"target.postion {UNKNOWN}; did you mean 'target.position'?",
    "target = 3": "target must be a table of keys, not 3",
    "target = 2024-01-01": "target must be a table of keys",
    'target.motion = "fly"': "target.motion must be one of ncv, waypoints, circle, lemniscate, manual, dataset, or 'package.module:Class', not 'fly'",
    "target.position = [1, 2]": "target.position must have 3 items, not 2",
    "target.position = [1, 2, 3, 4]": "target.position must have 3 items, not 4",
    'target.position = [1, "2", 3]': "target.position[1] must be a number, not '2'",
    "target.position = [nan, 0, 0]": "target.position[0] must be a finite number, not nan",
    "target.position = 3": "target.position must be a list of three numbers, as in [1.0, 2.0, 3.0], not 3",
    'target.motion = "waypoints"': "target.waypoints needs at least two points",
    'target.motion = "dataset"': "target.path must name the dataset folder",
    "target.acceleration_std = -1": "target.acceleration_std must be a number from 0 to 1000000, not -1",
    "agents.count = 0": "agents.count must be greater than or equal to 1, not 0",
    "agents.count = true": "agents.count must be a whole number, not true",
    "agents = {count = 3, positions = [[0, 0, 0], [1, 0, 0]]}": "agents.count = 3 is more than the 2 agents.positions; "
    "add positions or lower the count",
    "agents.positions = []": "agents.positions is empty; list a position for each agent",
    "agents = {count = 2, labels = ['a']}": "agents.labels lists 1 for 2 agents; give one each",
    'agents.low = "x"': "agents.low must be a number, or three numbers [x, y, z], each from -1e7 to 1e7, not 'x'",
    "agents.low = [1, 2]": "agents.low must have 3 items, not 2",
    "agents.high = true": "agents.high must be a number, or three numbers [x, y, z], each from -1e7 to 1e7, not true",
    "agents.high = nan": "agents.high must be a finite number, not nan",
    'agents.motion = "waypoints"': "agents.waypoints needs one list of points for each of the 6 agents",
    "agents = {count = 1, motion = 'waypoints', waypoints = [[]]}": "agents.waypoints needs one list of points",
    "sensor.range_std = 0": "sensor.range_std must be a number from 1e-09 to 10000000, not 0",
    'sensor.bias = "x"': "sensor.bias must be a number, or a list with a number for each agent, not 'x'",
    "sensor.bias = [1, 2]": "sensor.bias lists 2 values for 6 agents; give one, or one per agent",
    "sensor.outlier_probability = 1.5": "sensor.outlier_probability must be a number from 0 to 1, not 1.5",
    "sensor.dropout_probability = nan": "sensor.dropout_probability must be a finite number, not nan",
    'network.graph = "rign"': "network.graph must be one of erdos-renyi, ring, path, star, grid, complete, geometric",
    "network.probability = 0": "network.probability must be a number from 1e-09 to 1, not 0",
    "network.edges = 3": "network.edges must be a list, not 3",
    "network.edges = [[0, 1, 2]]": "network.edges[0] must have 2 items, not 3",
    "network.edges = [[0]]": "network.edges[0] must have 2 items, not 1",
    "network.edges = [[0, -1]]": "network.edges[0][1] must be greater than or equal to 0, not -1",
    "network.edges = [[0, 1.5]]": "network.edges[0][1] must be a whole number, not 1.5",
    "consensus.rounds = 1e3": "consensus.rounds must be a whole number, not 1000.0",
    "consensus.epsilon = 0": "consensus.epsilon must be greater than or equal to 0.000000001, not 0",
    'consensus.weights = "equal"': "consensus.weights must be 'uniform' or 'metropolis', not 'equal'",
    'consensus.scheme = "sums"': "consensus.scheme must be 'auto', 'average' or 'running-sums', not 'sums'",
    'consensus = {scheme = "running-sums", acceleration = "chebyshev"}': "consensus.scheme = 'running-sums' cannot be "
    "accelerated; set consensus.acceleration = 'none'",
    "filter.xi = 0": "filter.xi must be a number from 1e-06 to 1e+12, or 'auto', not 0",
    "filter.xi = inf": "filter.xi must be a finite number, not inf",
    'filter = {kind = "sicf", measurement = "difference"}': "filter.measurement = 'difference' would count ranges more "
    "than once in 'sicf', as agents' differences share them; set filter.kind = 'ci'",
    'filter.kind = "ekf"': f"filter.kind must be one of {', '.join(KINDS)}, or 'package.module:Class', not 'ekf'",
    "filter.initial_position = []": "filter.initial_position lists 0 values for 6 agents",
    "filter.initial_position = [1, 2]": "filter.initial_position must have 3 items, not 2",
    "filter.initial_position = [[1, 2]]": "filter.initial_position[0] must have 3 items, not 2",
    "filter.initial_velocity = [[1, 2, 3]]": "filter.initial_velocity lists 1 values for 6 agents",
    'filter.initial_velocity = "x"': "filter.initial_velocity must be three numbers [x, y, z], or a list with three",
    'timing.mode = "fast"': "timing.mode must be 'lockstep' or 'realtime', not 'fast'",
    "record.required = 1": "record.required must be true or false, not 1",
    'record.required = "yes"': "record.required must be true or false, not 'yes'",
    'zenoh.connect = "tcp/localhost:1"': "zenoh.connect must be a list, not 'tcp/localhost:1'",
    "zenoh.listen = [1]": "zenoh.listen[0] must be text in quotes, not 1",
    "fault = 3": "fault must be a list of tables, each written [[fault]], not 3",
    'fault = {kind = "loss"}': "fault must be a list of tables, each written [[fault]], not a table",
    "fault = [3]": f"fault[0].kind must be one of {FAULTS}",
    'fault = [{kind = "fire"}]': f"fault[0].kind must be one of {FAULTS}, or 'package.module:Class', not 'fire'",
    "fault = [{probability = 1}]": f"fault[0].kind must be one of {FAULTS}",
    'fault = [{kind = "loss"}]': "fault[0].probability is missing; add it",
    'fault = [{kind = "loss", probability = 2}]': "fault[0].probability must be a number from 0 to 1, not 2",
    'fault = [{kind = "loss", probability = nan}]': "fault[0].probability must be a finite number, not nan",
    'fault = [{kind = "loss", probability = "1"}]': "fault[0].probability must be a number from 0 to 1, not '1'",
    'fault = [{kind = "delay", milliseconds = 1, jiter_ms = 1}]': f"fault[0].jiter_ms {UNKNOWN}; "
    "did you mean 'fault[0].jitter_ms'?",
    'fault = [{kind = "loss", probability = 1, form = 1}]': f"fault[0].form {UNKNOWN}; did you mean 'fault[0].from'?",
    'fault = [{kind = "loss", probability = 1, links = "agnt:1"}]': "fault[0].links must be 'all', 'agent:3', "
    "pairs [[from, to], ...], or { between = [[0, 1, 2], [3, 4, 5]] }, not 'agnt:1'",
    'fault = [{kind = "loss", probability = 1, links = [[0, "a"]]}]': "fault[0].links[0][1] must be a whole number",
    'fault = [{kind = "partition", links = {between = [[0, 1]]}}]': "fault[0].links.between must be two or more lists",
    'fault = [{kind = "partition", links = {between = [[0, 1], ["a"]]}}]': "fault[0].links.between[1][0] must be a whole",
    'fault = [{kind = "partition", links = {betwen = [[0], [1]]}}]': f"fault[0].links.betwen {UNKNOWN}; did you mean 'fault[0].links.between'?",
    'fault = [{kind = "loss", probabilty = 0.3}]': f"fault[0].probabilty {UNKNOWN}; did you mean 'fault[0].probability'?",
    'fault = [{kind = "loss", prob = 0.3}]': f"fault[0].prob {UNKNOWN}; did you mean 'fault[0].probability'?",
    'fault = [{kind = "crash", agent = [3]}]': f"fault[0].agent {UNKNOWN}; did you mean 'fault[0].agents'?",
    'filter.knd = "icf"': f"filter.knd {UNKNOWN}; did you mean 'filter.kind'?",
    "rounds = 5": f"rounds {UNKNOWN}; did you mean 'consensus.rounds'?",
    "roundss = 5": f"roundss {UNKNOWN}; did you mean 'consensus.rounds'",
    "range_std = 5": f"range_std {UNKNOWN}; did you mean 'sensor.range_std' or 'filter.range_std'?",
    "network.rounds = 5": f"network.rounds {UNKNOWN}; did you mean 'consensus.rounds'?",
    'fault = [{kind = "partition", links = {between = [[0, 1], [2, 1]]}}]': "fault.links.between has agent 1 in two groups",
    'fault = [{kind = "outage"}]': "fault[0].agents is missing; add it",
    'fault = [{kind = "outage", agents = []}]': "fault[0].agents must be a list of agents, as in [3], not a list",
    'fault = [{kind = "outage", agents = [-1]}]': "fault[0].agents[0] must be greater than or equal to 0, not -1",
    'fault = [{kind = "sensor-bias", bias = 1, agents = "some"}]': "fault[0].agents must be 'all', or a list of agents",
    'fault = [{kind = "sensor-spikes", probability = 0.1, std = 0}]': "fault[0].std must be a number from 1e-09 to 10000000, not 0",
    'fault = [{kind = "burst-loss", good_to_bad = 0, bad_to_good = 1}]': "fault[0].good_to_bad must be a number from 1e-09 to 1, not 0",
    'fault = [{kind = "burst-loss", good_to_bad = 1e-4, bad_to_good = 1e-4}]': "fault.good_to_bad + fault.bad_to_good must lie",
    'fault = [{kind = "burst-loss", good_to_bad = 1, bad_to_good = 1}]': "fault.good_to_bad + fault.bad_to_good must lie",
    'fault = [{kind = "delay", milliseconds = 1, distribution = "gamma"}]': "fault[0].distribution must be 'constant', ",
    'fault = [{kind = "delay", milliseconds = 1, distribution = "normal"}]': "fault.std_ms is missing",
    'fault = [{kind = "delay", milliseconds = 1, std_ms = 1}]': "fault.std_ms is for distribution 'normal', not 'constant'",
    'fault = [{kind = "delay", milliseconds = 1, shape = 1}]': "fault[0].shape must be greater than 1, not 1",
    'fault = [{kind = "rate-limit", messages_per_second = -1}]': "fault[0].messages_per_second must be greater than or",
    'fault = [{kind = "clock", drift = inf}]': "fault[0].drift must be a finite number, not inf",
}

IMPOSSIBLE = {
    "agents.count = 3\nnetwork.edges = [[0, 1]]": "agents 2 cannot reach agents 0 and 1; add edges",
    "agents.count = 2\nnetwork.edges = []": "agents 1 cannot reach agents 0; add edges",
    "agents.count = 2\nnetwork.edges = [[0, 1], [1, 1]]": "network.edges: [1, 1] does not join two of the 2 agents",
    "agents.count = 2\nnetwork.edges = [[0, 1], [1, 2]]": "network.edges: [1, 2] does not join two of the 2 agents 0 to 1",
    'network = {graph = "geometric", radius = 0.001}': "the network falls apart",
    "agents.count = 20\nnetwork.probability = 1e-9": "network.probability = 1e-09 hardly ever joins 20 agents",
    'agents.count = 3\nnetwork.graph = "path"\nconsensus = {weights = "uniform", epsilon = 0.5}': "consensus.epsilon = 0.5 "
    "is at or above the stable limit 1/(largest degree) = 0.5 of this graph; lower it",
    'fault = [{kind = "loss", probability = 1, links = "agent:6"}]': "names agent 6, but agents are 0 to 5",
    'fault = [{kind = "loss", probability = 1, links = [[0, 9]]}]': "names agent 9, but agents are 0 to 5",
    'fault = [{kind = "outage", agents = [6]}]': "names agent 6, but agents are 0 to 5",
    'fault = [{kind = "sensor-stuck", agents = [1, 7]}]': "names agent 7, but agents are 0 to 5",
    'fault = [{kind = "partition", links = {between = [[0, 1], [2, 8]]}}]': "names agent 8, but agents are 0 to 5",
    'fault = [{kind = "loss", probability = 1, from = 2, until = 2}]': "until must be later than from",
    'filter.bias = "estimate"\nfault = [{kind = "byzantine", agents = [5]}]': "set filter.bias = 'none' or 'auto', or consensus.isolate",
    "steps = 10_000_000\ndt = 10_000\nsensor.range_std = 0.001": "the clock resolves ranges to",
}


def assert_one_sentence(message: str) -> None:
    assert "\n" not in message
    assert "pydantic" not in message
    assert "validation error" not in message
    assert "Input should" not in message


@pytest.mark.parametrize("text", REFUSED)
def test_a_mistyped_scenario_is_refused_with_file_key_and_remedy(text):
    with pytest.raises(UserError) as caught:
        parse(tomllib.loads(text), "my.toml")
    message = str(caught.value)
    assert message.startswith(f"my.toml: {REFUSED[text]}")
    assert_one_sentence(message)


@pytest.mark.parametrize("text", IMPOSSIBLE)
def test_what_cannot_work_is_refused_before_anything_starts(text):
    scenario = parse(tomllib.loads(text), "my.toml")
    with pytest.raises(UserError) as caught:
        check(Plan(scenario))
    message = str(caught.value)
    assert IMPOSSIBLE[text] in message
    assert_one_sentence(message)


@pytest.mark.parametrize(
    "text",
    [
        "dt = 1",
        "seed = 18446744073709551615",
        "agents = {count = 2, positions = [[0, 0, 0], [1, 2, 3], [4, 5, 6]]}",
        "agents.low = [-1, -1, 0]",
        "sensor.bias = [0, 0, 0, 0, 0, 1]",
        "filter.initial_position = [1, 2, 3]",
        'agents.count = 3\nnetwork.graph = "path"\nconsensus = {weights = "uniform", epsilon = 0.4999}',
        'fault = [{kind = "loss", probability = 1, links = [[0, 1]], from = 1, until = 2}]',
        "agents.count = 1",
        "agents = {count = 1}\nnetwork.edges = []",
    ],
)
def test_what_can_work_is_accepted(text):
    warnings = check(Plan(parse(tomllib.loads(text), "my.toml")))
    # So few agents do not see a position, or a target goes far from them: that is said, and no mistake.
    assert [one for one in warnings if "ranges of" not in one and "geometry is weak" not in one] == []


def test_several_mistakes_are_counted_and_the_branches_of_one_are_not():
    with pytest.raises(UserError, match=r"steps must be a whole number, not 'x' \(1 more\)$"):
        parse({"steps": "x", "agents": {"low": "y"}}, "my.toml")
    with pytest.raises(UserError) as caught:
        parse({"agents": {"low": "y"}}, "my.toml")
    assert "more)" not in str(caught.value)


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("consensus.rounds", "not of the form a.b=value"),
        ("=5", "not of the form a.b=value"),
        ("consensus..rounds=5", "not of the form a.b=value"),
        ("steps.x=5", "steps is not a table"),
        ("consensus.rounds=many", "consensus.rounds must be a whole number, not 'many'"),
        ("consensus.rouns=5", "did you mean 'consensus.rounds'?"),
        ("filter.xi=0", "filter.xi must be a number from 1e-06"),
        ("name=\udcff", "text that is not valid Unicode"),
        ("seed=" + "9" * 5000, "seed must be a whole number"),
        ("seed=0x" + "9" * 5000, "a number of too many digits"),
        ("dt=" + "[" * 5000, "not valid TOML: it nests more than 32 levels deep"),
    ],
)
def test_an_override_with_a_mistake_is_refused(override, said):
    with pytest.raises(UserError) as caught:
        load("tracking", ["steps=30", override])
    assert said in str(caught.value)
    assert_one_sentence(str(caught.value))
