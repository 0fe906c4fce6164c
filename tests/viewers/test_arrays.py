"""Exported tables: the same numbers whatever the format."""

import sys

import numpy as np
import pytest

from tests.cli.command_line import call
from tests.log.made import made_log
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.viewers.arrays import arrays_of, export


def test_parquet_holds_the_tables_of_csv(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    trace = read_trace(made_log(tmp_path / "run.mcap", "steps=9", "sensor.dropout_probability=0.2"))
    tables = {path.stem: path for path in export(trace, tmp_path / "tables", "parquet")}
    texts = {path.stem: path for path in export(trace, tmp_path / "texts", "csv")}
    assert tables.keys() == texts.keys() == {"truth", "initial", "edges", "agents", "estimates"}
    for name, path in tables.items():
        columns = parquet.read_table(path).to_pydict()
        text = np.genfromtxt(texts[name], delimiter=",", names=True)
        assert tuple(columns) == text.dtype.names
        for column, values in columns.items():
            assert np.array_equal(np.array(values, dtype=np.float64), text[column], equal_nan=True), (name, column)
    steps = parquet.read_table(tables["estimates"]).to_pydict()
    assert all(isinstance(step, int) for step in steps["k"])
    assert np.array_equal(np.array(steps["x"]), arrays_of(trace)["estimates"][:, :, 0].ravel())


def test_without_pyarrow_parquet_is_refused(tmp_path, monkeypatch):
    trace = read_trace(made_log(tmp_path / "run.mcap", "steps=3"))
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(UserError, match="pip install"):
        export(trace, tmp_path / "tables", "parquet")
    assert not (tmp_path / "tables").exists()


def test_a_log_is_not_overwritten_by_its_own_export(monkeypatch, capsys, tmp_path):
    log = made_log(tmp_path / "run.mcap", "steps=3")
    before = log.read_bytes()
    status, _, err = call(monkeypatch, capsys, "export", str(log), "--to", "viz", "-o", str(log))
    assert status == 2
    assert "logs are never overwritten" in err
    assert log.read_bytes() == before
