"""What a log means does not change with later versions."""

from zenoh_cbef.scenario.legacy import as_meant
from zenoh_cbef.scenario.load import parse


def test_a_log_without_the_key_is_of_the_first_rules():
    assert parse(as_meant({"filter": {"kind": "icf"}}), "a log").filter.defaults == 1
    assert parse(as_meant({}), "a log").filter.defaults == 1


def test_a_log_that_has_the_key_keeps_it():
    assert parse(as_meant({"filter": {"defaults": 2}}), "a log").filter.defaults == 2


def test_a_scenario_of_today_is_of_todays_rules():
    assert parse({}, "a scenario").filter.defaults == 29
