"""A recording: each verb reads a log once, and what is kept is the first message of each place."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.cli.command_line import call
from tests.log.hand_made import KEYS, Maker
from tests.log.made import made_log
from zenoh_cbef.log.mcap.contents import Chunk, decompress
from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.log.read.columns import Columns
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.receipts import Receipt, Receipts
from zenoh_cbef.log.read.recording import read_recording
from zenoh_cbef.log.read.tables import Table
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.scenario.plan import Plan

STEPS = 20


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = made_log(tmp_path_factory.mktemp("once") / "run.mcap", f"steps={STEPS}", "record.chunk_bytes=2048")
    assert open_log(path).summary().chunks > 10
    return path


@pytest.mark.parametrize(
    "verb",
    [
        "info {log}",
        "check {log}",
        "analyze {log} --json",
        "compare {log} --json",
        "verify {log}",
        "timeline {log} -o {new}.svg",
        "export {log} -o {new}.npz",
        "export {log} --to viz -o {new}.mcap",
        "reestimate {log} -o {new}.mcap",
        "cat {log}",
        "filter {log} -o {new}.mcap",
        "merge {log} -o {new}.mcap",
        "recover {log} -o {new}.mcap",
    ],
)
def test_a_verb_opens_a_log_once_and_reads_each_chunk_once(log, tmp_path, monkeypatch, capsys, verb):
    opened: Counter[Path] = Counter()
    read: Counter[int] = Counter()
    before = McapFile.__init__

    def opening(file: McapFile, path: Path, **options: bool) -> None:
        opened[path] += 1
        before(file, path, **options)

    def reading(data: bytes, chunk: Chunk) -> bytes:
        read[chunk.data_start] += 1
        return decompress(data, chunk)

    chunks = open_log(log).summary().chunks
    monkeypatch.setattr(McapFile, "__init__", opening)
    monkeypatch.setattr("zenoh_cbef.log.mcap.reader.decompress", reading)
    status, _, err = call(monkeypatch, capsys, *verb.format(log=log, new=tmp_path / "new").split())
    assert status == 0, err
    assert opened == {log: 1}
    # What a file holds stands in its summary.
    assert (len(read), set(read.values())) == ((0, set()) if verb.startswith("info") else (chunks, {1}))


@given(st.lists(st.lists(st.tuples(st.integers(0, 2), st.integers(-1, 90), st.floats(0, 1)), min_size=1), max_size=9))
def test_a_table_holds_the_first_message_of_each_place(batches):
    table, expected = Table(3, 80, value=1), dict[tuple[int, int], float]()
    for batch in batches:
        row, step, value = (np.array(column) for column in zip(*batch, strict=True))
        new = table.put(row, step, value=value.reshape(-1, 1))
        for place, (at, number, one) in enumerate(batch):
            first = 1 <= number <= 80 and (at, number) not in expected
            assert new[place] == first
            if first:
                expected[at, number] = one
    seen, values = table.seen(80), table.numbers("value", 80)
    assert {(row, step + 1) for row, step in np.argwhere(seen)} == expected.keys()
    assert all(values[row, step - 1, 0] == one for (row, step), one in expected.items())
    assert np.isnan(values[~seen]).all()
    assert table.last == max((step for _, step in expected), default=0)


def estimate(step: int, seq: int, received: int, **more):
    counts = {"received": [received, 0], "lost": [0, 1], "late": [0, 0], "latency": [0.5, None]}
    return {"k": step, "seq": seq, "neighbours": [3, 1], **counts, **more}


def test_an_agents_counts_are_kept_by_step_and_begin_anew_with_its_next_life():
    receipts, injected = Receipts(50), {"injected_lost": [0, 1], "fates": ["..", "x."]}
    messages = [estimate(1, 0, 5), estimate(2, 1, 9, **injected), estimate(7, 0, 2)]
    receipts.put(np.array([1, 2, 7]), Columns.of(messages), np.ones(3, dtype=bool))
    assert receipts.steps(50).tolist() == [1, 2, 7]
    assert receipts.begun(50).tolist() == [False, False, True]
    assert receipts.counts("received", 50)[:, 0].tolist() == [5, 9, 2]
    assert np.isnan(receipts.counts("latency", 50)[:, 1]).all()
    counts = {"received": [9, 0], "lost": [0, 1], "late": [0, 0]}
    assert receipts.told(2) == Receipt([3, 1], counts | {"injected_lost": [0, 1]}, ["..", "x."])
    assert [told.marks if (told := receipts.told(step)) else "" for step in (1, 7)] == [None, None]
    assert receipts.told(3) is receipts.told(0) is None


@pytest.mark.parametrize("odd", [{"neighbours": [1, 3]}, {"lost": [1]}, {"latency": [1.0]}, {"fates": ["."]}])
def test_counts_that_are_not_of_the_neighbours_are_left_out(odd):
    receipts = Receipts(50)
    messages = Columns.of([estimate(1, 0, 5), estimate(2, 1, 9) | odd, estimate(3, 2, 11)])
    receipts.put(np.array([1, 2, 3]), messages, np.ones(3, dtype=bool))
    assert receipts.steps(50).tolist() == [1, 3]


def test_an_estimate_that_was_asked_for_later_is_no_new_life(tmp_path):
    maker = Maker(tmp_path / "run.mcap")
    key, late = KEYS.estimate(0), b""
    for k in range(1, 9):
        counts = {"neighbours": [1], "received": [k], "lost": [0], "late": [0], "latency": [1e-3]}
        body = {"k": k, "state": [0.5] * 6, "innovation": 0.1, "weight": None, **counts}
        data = maker.send(key, "agent/0", **body, covariance=None, logged=k != 5)
        if k == 5:
            late = data
        if k == 7:
            maker.log.add(key, late, maker.now)
    maker.close()
    trace = read_trace(tmp_path / "run.mcap")
    assert np.isfinite(trace.estimates[0]).all()
    link = (trace.links.destination == 0) & (trace.links.source == 1)
    assert trace.links.delivered[link].tolist() == [8]


def test_a_round_that_the_run_does_not_have_is_not_kept(tmp_path):
    maker = Maker(tmp_path / "run.mcap", "consensus.rounds=2")
    maker.step(1)
    codec, payload = maker.codecs[0], np.zeros(Plan(maker.scenario).message_size)
    for seq, round_ in enumerate((2, 3, 0), 1):
        maker.log.add(KEYS.round(0), codec.encode(seq, maker.now, 2, round_, payload), maker.now)
    maker.close()
    recording = read_recording(open_log(tmp_path / "run.mcap"), rounds="times")
    assert recording.tally.recorded == 1 + 3 * 4 + 3
    assert np.argwhere(recording.rounds.seen(3)).tolist() == [[0, 0], [1, 1], [2, 0], [4, 0]]


def test_a_log_whose_estimates_have_another_field_says_that_it_is_not_understood(tmp_path, monkeypatch, capsys):
    made = Maker(tmp_path / "run.mcap")
    for k in (1, 2):
        made.send(KEYS.truth, "target", k=k, state=[0.0] * 6)
        made.send(KEYS.estimate(0), "agent/0", k=k, state=[0.0] * 6, novelty=1.0)
    made.close()
    status, _, said = call(monkeypatch, capsys, "analyze", str(tmp_path / "run.mcap"))
    assert status == 2
    assert "holds no estimate: 2 of its messages are not as this version writes them; zenoh-cbef check says" in said
