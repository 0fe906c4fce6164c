"""Recordings in other formats become datasets, with the source's own times."""

from __future__ import annotations

import numpy as np
import pytest

from tests.datasets.walked import CORNERS, EPOCH, STEPS, anchors_in, distance, imported, is_the_walk, place
from tests.log.made import made_log
from zenoh_cbef.datasets import read_dataset, write_dataset
from zenoh_cbef.datasets.importing.columns import map_of
from zenoh_cbef.datasets.importing.units import units_of
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.viewers.recording import dataset_of


def long_rows(unit, separator, comma="."):
    for k in range(STEPS):
        for name in CORNERS:
            values = [str(EPOCH * 1000 + 100 * k), name, "good", f"{distance(k, name) / unit:.3f}".replace(".", comma)]
            yield separator.join(values)


@pytest.mark.parametrize(
    ("head", "unit", "marks", "options"),
    [
        ("stamp_ms;Station;quality;Dist [mm]", 0.001, (";", ","), ["--map", "anchor=station"]),
        ("stamp,anchor,quality,rng", 0.3048, (",", "."), ["--map", "range=rng", "--unit", "range=ft"]),
        ("timestamp\tid\tquality\trange", 1.0, ("\t", "."), ["--unit", "t=ms"]),
    ],
)
def test_csv_with_any_columns_units_and_separators(tmp_path, head, unit, marks, options):
    text = "\n".join(["# a comment", head, *long_rows(unit, *marks)])
    (tmp_path / "log.csv").write_text("\ufeff" + text, encoding="utf-8")
    stations = anchors_in(tmp_path, 0.3048, "name,x_ft,y_ft,z_ft")
    said = imported(tmp_path / "log.csv", "--anchors", stations, "-o", tmp_path / "set", *options)
    is_the_walk(read_dataset(tmp_path / "set"))
    assert "none: no errors are shown" in said
    assert (tmp_path / "set" / "first-fix.png").stat().st_size > 1000
    scenario = load(str(tmp_path / "set" / "scenario.toml")).scenario
    # Ten ranges a second without any noise, of a target that goes round at 3 m/s.
    assert (scenario.dt, scenario.length) == (0.025, 4 * STEPS - 3)
    assert scenario.target.origin == pytest.approx(EPOCH - 0.025)
    with pytest.raises(UserError, match="--force"):
        imported(tmp_path / "log.csv", "--anchors", stations, "-o", tmp_path / "set", *options)


def test_numbers_that_a_run_refuses_are_left_out(tmp_path):
    rows = [f"{0.1 * k},{name},{distance(k, name)}" for k in range(40) for name in CORNERS]
    (tmp_path / "log.csv").write_text("\n".join(["t,anchor,range", *rows, "4,a,1e9", "1e13,a,3"]))
    (tmp_path / "way.csv").write_text("t,x,y,z\n0,1,2,3\n1,1e8,2,3")
    options = ["--truth", tmp_path / "way.csv", "-o", tmp_path / "set"]
    said = " ".join(imported(tmp_path / "log.csv", "--anchors", anchors_in(tmp_path), *options).split())
    assert "2 ranges beyond 1e+07 m, or at times beyond 1e+12 s, left out" in said
    assert "1 true position beyond 1e+07 m left out" in said
    found = read_dataset(tmp_path / "set")
    assert (len(found.ranges), len(found.truth)) == (len(rows), 1)
    (tmp_path / "stations.csv").write_text("id,x,y,z\na,1e8,0,0\n")
    with pytest.raises(UserError, match=r"anchor a is beyond 1e\+07 m"):
        imported(tmp_path / "log.csv", "--anchors", tmp_path / "stations.csv", "-o", tmp_path / "other")


def test_what_a_run_refuses_is_told_by_import(tmp_path):
    names = {"a": "1.5", "b": "2.5"}
    rows = [f"{0.1 * k},{names[name]},{distance(k, name)}" for k in range(40) for name in names]
    (tmp_path / "log.csv").write_text("\n".join(["t,anchor,range", *rows]))
    (tmp_path / "stations.csv").write_text("id,x,y,z\n1.5,0,0,2\n2.5,20,1,2\n")
    said = " ".join(
        imported(tmp_path / "log.csv", "--anchors", tmp_path / "stations.csv", "-o", tmp_path / "set").split()
    )
    assert "'run' refuses" in said
    assert "has an anchor id that is not a whole number" in said
    assert "next: import again with what is said above" in said


def test_columns_of_a_file_without_a_header_are_known_by_their_place(tmp_path):
    rows = [(3152.0 + 0.25 * k, 2, k % 4, 10.0 + k) for k in range(40)]
    (tmp_path / "log.txt").write_text("".join("  ".join(f"{one:.9e}" for one in row) + "\n" for row in rows))
    (tmp_path / "nodes.csv").write_text("0,0,0,0\n1,60,0,0\n2,60,60,0\n3,0,60,0\n")
    columns = ["ranges.t=1", "ranges.anchor=3", "ranges.range=4", "anchors.anchor=1", "x=2", "y=3", "z=4"]
    options = [part for one in columns for part in ("--map", one)]
    imported(tmp_path / "log.txt", "--anchors", tmp_path / "nodes.csv", "-o", tmp_path / "set", *options)
    dataset = read_dataset(tmp_path / "set")
    assert dataset.labels == ("0", "1", "2", "3")
    np.testing.assert_allclose(dataset.ranges, [row[3] for row in rows], atol=1e-6)


def test_a_folder_with_a_column_for_each_anchor_and_a_truth(tmp_path):
    source = tmp_path / "monday"
    source.mkdir()
    anchors_in(source)
    wide = [",".join([str(EPOCH + 0.1 * k), *(f"{distance(k, each):.6f}" for each in CORNERS)]) for k in range(STEPS)]
    (source / "uwb.csv").write_text("\n".join(["t," + ",".join(f"d_{each}" for each in CORNERS), *wide]))
    known = [",".join(map(str, (EPOCH + 0.1 * k, *place(k)))) for k in range(50)]
    (source / "mocap.csv").write_text("\n".join(["time,pos_x,pos_y,pos_z", *known]))
    said = imported(source, "-o", tmp_path / "set", "--map", "range=d_*")
    is_the_walk(read_dataset(tmp_path / "set"))
    assert "the truth covers 4.9" in said
    assert "only those are scored" in said


def test_what_cannot_be_used_is_left_out_and_told(tmp_path):
    rows = [f"{0.1 * k},{name},{distance(k, name)}" for k in range(STEPS) for name in CORNERS]
    (tmp_path / "log.csv").write_text("\n".join(["t,anchor,range", *rows, "1,z,2", "2,a,nan", "3,b,-1"]))
    said = imported(tmp_path / "log.csv", "--anchors", anchors_in(tmp_path), "-o", tmp_path / "set")
    for told in ("1 range of anchor z, which has no position, left out", "1 row of log.csv", "1 negative range left"):
        assert told in said
    is_the_walk(read_dataset(tmp_path / "set"), 0.0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--map", "rnage=d"], "is not MEANING=COLUMN"),
        (["--unit", "range=yd"], "is no unit"),
        (["--map", "ranges.range=nothing"], "has no such column"),
        (["--map", "anchor.x=x"], r"is not MEANING=COLUMN.*with a file \(anchors, truth, ranges\)"),
        (["--map", "t=when", "--map", "range=quux", "--map", "z=up"], "no file has such a column; there are when"),
        (["--map", "range=d_*"], "--map range=d_[*]: no column is named so; there are when, anchor, quux"),
        (["--unit", "rnge=mm"], "'rnge' is no column"),
        (["--unit", "truth.t=mm"], "truth.t is no length"),
        (["--map", "t=when"], "which column is range.* --map ranges.range=COLUMN"),
        ([], "which columns are t and range.* --map ranges.t=COLUMN --map ranges.range=COLUMN"),
    ],
)
def test_mistakes_are_told_with_the_remedy(tmp_path, words, said):
    (tmp_path / "log.csv").write_text("when,anchor,quux\n0,a,1\n")
    with pytest.raises(UserError, match=said):
        imported(tmp_path / "log.csv", "--anchors", anchors_in(tmp_path), "-o", tmp_path / "set", *words)


@pytest.mark.filterwarnings("error")
def test_too_few_ranges_to_track_anything_are_told_as_that(tmp_path):
    (tmp_path / "log.csv").write_text("t,anchor,range\n1,a,2\n")
    said = " ".join(imported(tmp_path / "log.csv", "--anchors", anchors_in(tmp_path), "-o", tmp_path / "set").split())
    assert "1 range cannot determine position and velocity, 4 unknowns; import more of the recording" in said
    assert "anchor b has no range" in said


def test_a_spreadsheet_of_windows_keeps_its_letters(tmp_path):
    rows = [f"{0.1 * k};{name};{distance(k, name)}" for k in range(40) for name in CORNERS]
    (tmp_path / "log.csv").write_text("\n".join(["t;Küche;range", *rows]), encoding="cp1252")
    options = ["--map", "ranges.anchor=Küche", "-o", tmp_path / "set"]
    imported(tmp_path / "log.csv", "--anchors", anchors_in(tmp_path), *options)
    assert read_dataset(tmp_path / "set").labels == tuple(CORNERS)


def test_a_run_becomes_a_dataset_that_gives_the_same_ranges(tmp_path):
    [trace] = simulate([load("tracking", ["steps=40"]).scenario])
    write_dataset(dataset_of(trace), tmp_path / "set")
    [again] = simulate([load("tracking", ["target.motion=dataset", f'target.path="{tmp_path / "set"}"']).scenario])
    np.testing.assert_allclose(again.ranges, trace.ranges, atol=1e-6)
    np.testing.assert_allclose(again.truth[1:-1, :3], trace.truth[1:-1, :3], atol=1e-6)
    moving = load("tracking", ["agents.motion=formation", "agents.velocity=[1,0,0]", "steps=5"]).scenario
    with pytest.raises(UserError, match="agents of this run move"):
        dataset_of(simulate([moving])[0])


def test_maps_and_units_are_read_from_words():
    assert map_of(["range=d_*", "truth.t=Stamp"]) == {"range": "d_*", "truth.t": "Stamp"}
    units = units_of(["mm", "anchors=ft", "t=us"])
    assert [str(units.length(file, "x", "x")) for file in ("anchors", "truth")] == ["0.3048", "0.001"]


def test_logs_of_runs_and_files_that_are_no_text_are_named_as_such(tmp_path):
    for source in (made_log(tmp_path / "run.mcap", "steps=2"), tmp_path):
        with pytest.raises(UserError, match=r"is a log of zenoh-cbef; make a dataset of it: zenoh-cbef export .* --to"):
            imported(source, "-o", tmp_path / "set")
    ranges = tmp_path / "ranges.csv"
    for name, data in (("UTF-16 text; save it as UTF-8", "t,a\n1,2\n".encode("utf-16")), ("no text", b"t,a\n\0\n")):
        ranges.write_bytes(data)
        with pytest.raises(UserError, match=f"ranges.csv is {name}"):
            imported(ranges, "-o", tmp_path / "set")


def of_two_tags(tmp_path):
    folder = tmp_path / "both"
    folder.mkdir()
    anchors_in(folder)
    rows = [f"{0.1 * k},{tag},{name},{distance(k, name) + 3 * tag}"
            for k in range(20) for name in CORNERS for tag in (0, 1)]  # fmt: skip
    (folder / "ranges.csv").write_text("\n".join(["t,Tag_ID,anchor_id,range", *rows]))
    return folder


def test_ranges_of_several_targets_are_told_and_those_of_one_are_taken(tmp_path):
    folder = of_two_tags(tmp_path)
    assert "ranges.csv has ranges of 2 targets" in imported(folder, "-o", tmp_path / "mixed")
    said = imported(folder, "-o", tmp_path / "one", "--only", "tag_id=1")
    assert "--only" not in said
    found = read_dataset(tmp_path / "one")
    assert len(found.ranges) == 20 * len(CORNERS)
    np.testing.assert_allclose(found.ranges[:5], [distance(0, name) + 3 for name in CORNERS], atol=1e-6)
    for wrong, why in (("tag_id=7", "tag_id is 0 and 1"), ("tag", "is not COLUMN=VALUE"), ("who=1", "has t, Tag_ID")):
        with pytest.raises(UserError, match=why):
            imported(folder, "-o", tmp_path / "x", "--only", wrong)


def test_ranges_of_nothing_are_left_out_and_odd_times_and_columns_named(tmp_path):
    folder = tmp_path / "odd"
    folder.mkdir()
    anchors_in(folder)

    def said(text, *options):
        (folder / "ranges.csv").write_text(text)
        return " ".join(imported(folder, "-o", tmp_path / "set", "--force", *options).split())

    rows = "".join(f"{k},{name},{0 if k == 3 else 9}\n" for k in range(9) for name in "abcde")
    assert "5 ranges of 0 m, which say that nothing was measured, left out" in said("t,anchor,range\n" + rows)
    with pytest.raises(UserError, match=r"time of .* has no times, as '23:59:50'"):
        said("time,anchor,range\n23:59:50,a,3\n23:59:51,b,4\n")
    with pytest.raises(UserError, match=r'--map "range=d_\*"'):
        said("t,d_n1,d_n2,d_n3\n0,1,2,3\n")
    with pytest.raises(UserError, match=r"--map ranges\.range=COLUMN$"):
        said("t,one,two\n0,1,2\n")
