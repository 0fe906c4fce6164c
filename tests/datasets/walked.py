"""A target that walks among five anchors, as files of other programs, and what `import` makes of them."""

from __future__ import annotations

import math

import numpy as np
from typer.testing import CliRunner

from zenoh_cbef.cli.importing import VERB

CORNERS = {
    "a": (0.0, 0.0, 2.0),
    "b": (20.0, 1.0, 2.0),
    "c": (19.0, 15.0, 2.0),
    "d": (1.0, 12.0, 2.0),
    "e": (9.0, 18.0, 2.0),
}
EPOCH = 1_700_000_000
STEPS = 200


def place(k):
    return (10.0 + 6.0 * math.cos(0.05 * k), 7.0 + 5.0 * math.sin(0.05 * k), 1.0)


def distance(k, anchor):
    return math.dist(place(k), CORNERS[anchor])


def imported(*arguments):
    """Call the verb; returns what it printed."""
    said = CliRunner().invoke(VERB, [*map(str, arguments)])
    if said.exception is not None and not isinstance(said.exception, SystemExit):
        raise said.exception
    return said.output


def anchors_in(folder, length=1.0, head="id,x,y,z"):
    rows = "".join(f"{name},{x / length},{y / length},{z / length}\n" for name, (x, y, z) in CORNERS.items())
    (folder / "stations.csv").write_text(f"{head}\n{rows}")
    return folder / "stations.csv"


def is_the_walk(dataset, begin=float(EPOCH)):
    assert dataset.labels == tuple(CORNERS)
    assert len(dataset.ranges) == STEPS * len(CORNERS)
    steps = np.round((dataset.range_time - begin) / 0.1).astype(int)
    np.testing.assert_allclose(dataset.range_time, begin + 0.1 * steps, atol=1e-6)
    expected = [distance(k, dataset.labels[each]) for k, each in zip(steps, dataset.range_anchor, strict=True)]
    np.testing.assert_allclose(dataset.ranges, expected, atol=1e-3)
    np.testing.assert_allclose(dataset.anchors, list(CORNERS.values()), atol=1e-9)


def written(tmp_path, *, order="abcde", known=STEPS, seconds=1.0, of=1.0, corners=1.0, way=1.0):
    """The walk as files for `import`: ranges, anchors, and the truth of its first steps.

    order: whose ranges stand under each anchor's name. seconds, of, corners, way: what times, ranges, anchors and truth
    are divided by, as though they were in another unit.
    """
    folder = tmp_path / "walk"
    folder.mkdir()
    anchors_in(folder, corners)
    named = dict(zip(CORNERS, order, strict=True))
    rows = [f"{0.1 * k / seconds},{name},{distance(k, named[name]) / of}" for k in range(STEPS) for name in CORNERS]
    (folder / "ranges.csv").write_text("\n".join(["t,anchor_id,range", *rows]))
    if known:
        rows = [",".join(map(str, (0.1 * k / seconds, *(x / way for x in place(k))))) for k in range(known)]
        (folder / "truth.csv").write_text("\n".join(["t,x,y,z", *rows]))
    return folder
