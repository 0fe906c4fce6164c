"""The experiment file: what is read, and the one sentence that a mistake gets before anything runs."""

from pathlib import Path

import pytest

from zenoh_cbef.errors import UserError
from zenoh_cbef.experiment.cells import Cell, cells_of, selected
from zenoh_cbef.experiment.file import builtin_names, read_experiment
from zenoh_cbef.experiment.summary import check_expectations
from zenoh_cbef.scenario import Scenario

LOSS = '[[fault]]\nkind = "loss"\nprobability = 0.0\n[[vary]]\nkey = "fault.0.probability"\nvalues = [0.0, 0.3]\n'


def written(folder: Path, text: str):
    path = folder / "mine.toml"
    path.write_text(text)
    return read_experiment(str(path))


def scenarios_of(cells: list[Cell]) -> list[Scenario]:
    """What the cells run; each must have a scenario."""
    assert [cell.error for cell in cells if cell.scenario is None] == []
    return [cell.scenario for cell in cells if cell.scenario is not None]


def check_all(folder: Path, text: str) -> None:
    one = written(folder, text)
    check_expectations(one, cells_of(one))


MISTAKES = {
    "no TOML": ("seeds = ", "not valid TOML"),
    "unknown key": ("seed = 3", "did you mean 'seeds'"),
    "unknown key of vary": ('[[vary]]\nkey = "steps"\nvalue = [1]', "did you mean 'values'"),
    "no values": ('[[vary]]\nkey = "steps"\nvalues = []', "one or more values"),
    "values missing": ('[[vary]]\nkey = "steps"', "vary[0].values is missing"),
    "no seed": ("seeds = 0", "seeds must be a number of at least 1, or a list"),
    "no seeds": ("seeds = []", "seeds must be a number of at least 1, or a list"),
    "seeds in words": ('seeds = "many"', "seeds must be a number of at least 1, or a list"),
    "a seed twice": ("seeds = [1, 1]", "twice"),
    "a date": ("[set]\nsteps = 2020-01-01", "date"),
    "unknown engine": ('engine = "magic"', "engine must be 'simulate' or 'processes'"),
    "no limit": ('[[expect]]\nmetric = "position_rmse"', "give at_most or at_least"),
    "limit in words": ('[[expect]]\nmetric = "position_rmse"\nat_most = "low"', "expect[0].at_most"),
    "the seed varied": ('[[vary]]\nkey = "seed"\nvalues = [1]', "give the seeds as seeds"),
    "a key twice": ('[[vary]]\nkey = "steps"\nvalues = [1]\n' * 2, "varied twice"),
    "a value twice": ('[[vary]]\nkey = "steps"\nvalues = [4, 4]', "listed twice"),
    "no base": ('base = "trakcing"', "did you mean 'tracking'"),
    "no scenario key": ('[[vary]]\nkey = "consensus.roundz"\nvalues = [1]', "did you mean 'consensus.rounds'"),
    "no such setting": ('[set]\n"filter.kind" = "magic"', "filter.kind"),
    "no such fault": ('[[vary]]\nkey = "fault.0.probability"\nvalues = [0.1]', "there is no entry 0"),
    "not a table": ('[[vary]]\nkey = "steps.x"\nvalues = [0.1]\n[set]\nsteps = 4', "steps is not a table"),
    "no table": ("vary = [3]", "vary[0] must be a table of keys"),
    "no list of faults": ('[[vary]]\nkey = "fault"\nvalues = [1, 2]', "fault must be a list of tables"),
    "no such number": (LOSS + '[[expect]]\nmetric = "position_rms"\nat_most = 1', "did you mean 'position_rmse'"),
    "nowhere": (LOSS + '[[expect]]\nmetric = "x"\nat_most = 1\nwhere = { rounds = 3 }', "names no varied key"),
    "no such cell": (
        LOSS + '[[expect]]\nmetric = "x"\nat_most = 1\nwhere = { loss = 0.4 }',
        "no cell has where.loss = 0.4; use one of its values, 0.0, ",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_sentence_before_anything_runs(tmp_path, mistake):
    text, words = MISTAKES[mistake]
    with pytest.raises(UserError) as refused:
        check_all(tmp_path, text)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "name",
    ["loss", "probability", "loss.probability", "fault.0.probability", "0.probability", "fault.loss.probability"],
)
def test_where_takes_every_name_of_a_varied_key(tmp_path, name):
    cells = cells_of(written(tmp_path, LOSS))
    assert [cell.values for cell in selected(cells, {name: 0.3}, "x")] == [{"fault.0.probability": 0.3}]


def test_where_refuses_a_name_that_two_keys_have(tmp_path):
    two = LOSS + '[[vary]]\nkey = "sensor.outlier_probability"\nvalues = [0.1]\n'
    two += '[[vary]]\nkey = "network.probability"\nvalues = [0.5, 0.9]\n'
    cells = cells_of(written(tmp_path, two))
    with pytest.raises(UserError, match="or more than one"):
        selected(cells, {"probability": 0.3}, "x")
    assert len(selected(cells, {"loss": 0.3, "network.probability": 0.9}, "x")) == 1


def test_where_selects_by_the_faults_of_a_varied_list(tmp_path):
    text = '[[vary]]\nkey = "fault"\nvalues = [[], [{ kind = "loss", probability = 0.3 }]]'
    cells = cells_of(written(tmp_path, text))
    assert [cell.index for cell in selected(cells, {"loss": 0.3}, "x")] == [1]


def test_a_fault_is_named_by_its_kind(tmp_path):
    text = LOSS.replace("fault.0", "fault.loss")
    assert [one.model_dump()["fault"][0]["probability"] for one in scenarios_of(cells_of(written(tmp_path, text)))] == [
        0.0,
        0.3,
    ]


def test_set_takes_dotted_keys_and_tables(tmp_path):
    text = '[set]\n"consensus.rounds" = 4\nfilter.kind = "icf"\nsteps = 7\n'
    (scenario,) = scenarios_of(cells_of(written(tmp_path, text)))
    assert (scenario.consensus.rounds, scenario.filter.kind, scenario.steps) == (4, "icf", 7)


def test_the_grid_has_every_combination_and_the_last_key_changes_fastest(tmp_path):
    text = '[[vary]]\nkey = "steps"\nvalues = [3, 4]\n[[vary]]\nkey = "consensus.rounds"\nvalues = [1, 2, 3]\n'
    cells = cells_of(written(tmp_path, text))
    assert [tuple(cell.values.values()) for cell in cells] == [(a, b) for a in (3, 4) for b in (1, 2, 3)]
    assert [(one.steps, one.consensus.rounds) for one in scenarios_of(cells)] == [
        tuple(cell.values.values()) for cell in cells
    ]


def test_the_base_may_be_a_file_beside_the_experiment(tmp_path):
    (tmp_path / "base.toml").write_text('name = "beside"\nsteps = 5\n')
    (scenario,) = scenarios_of(cells_of(written(tmp_path, 'base = "base.toml"\n')))
    assert (scenario.name, scenario.steps) == ("beside", 5)


@pytest.mark.parametrize("name", builtin_names())
def test_built_in_experiments_can_run_and_say_what_they_expect(name):
    one = read_experiment(name)
    cells = cells_of(one)
    check_expectations(one, cells)
    assert len(cells) > 1
    assert all(cell.scenario is not None for cell in cells)
    assert one.purpose
    assert one.experiment.expect
