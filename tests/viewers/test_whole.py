"""An export that fails leaves no broken file behind, and what was there before stays."""

import errno
from pathlib import Path

import numpy as np
import pytest

from tests.log.made import made_log
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.mcap.writer import McapWriter
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.viewers import arrays, viz
from zenoh_cbef.viewers.scene import read_scene
from zenoh_cbef.writing import write_whole


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_log(tmp_path_factory.mktemp("made") / "run.mcap", "steps=3")


def full(place, *_, **__):
    """Writes a little onto a disk that is full then."""
    if isinstance(place, Path):
        place.write_text("half")
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize(("kind", "name"), [("npz", "out.npz"), ("csv", "out/truth.csv"), ("viz", "out.mcap")])
def test_a_full_disk_leaves_what_was_there(monkeypatch, tmp_path, log, kind, name):
    (place := tmp_path / name).parent.mkdir(exist_ok=True)
    place.write_text("before")
    for where, what in ((np, "savez_compressed"), (np, "savetxt"), (McapWriter, "add_metadata")):
        monkeypatch.setattr(where, what, full)
    export = {
        "npz": lambda: arrays.export(read_trace(log), place, "npz"),
        "csv": lambda: arrays.export(read_trace(log), place.parent, "csv"),
        "viz": lambda: viz.write_viz(read_scene(log), place),
    }
    with pytest.raises(UserError, match=r"cannot write .*: No space left on device; make room"):
        export[kind]()
    assert place.read_text() == "before"
    assert [one for one in tmp_path.rglob("*") if one.is_file()] == [place]


def test_a_text_that_cannot_be_written_to_its_end_leaves_what_was_there(tmp_path):
    place = tmp_path / "page.html"
    write_whole(place, "before")
    with pytest.raises(UnicodeEncodeError):
        write_whole(place, "half of it, then \ud800")
    assert place.read_text() == "before"
    assert list(tmp_path.iterdir()) == [place]
