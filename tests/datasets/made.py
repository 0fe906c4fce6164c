"""A data set of two anchors and five ranges, in files."""

from __future__ import annotations

from zenoh_cbef.scenario.load import load

ANCHORS = "id,x,y,z\n3,0,0,1\n7,4,0,1\n"


RANGES = "t,anchor_id,range\n10.0,3,1.0\n10.1,7,2.0\n10.2,3,3.0\n10.25,3,4.0\n10.4,7,5.0\n"


TRUTH = "t,x,y,z\n9,0,0,1\n11,2,4,1\n13,2,4,3\n"


def write(folder, anchors=ANCHORS, ranges=RANGES, truth=TRUTH):
    folder.mkdir(exist_ok=True)
    for name, text in (("anchors", anchors), ("ranges", ranges), ("truth", truth)):
        if text is not None:
            (folder / f"{name}.csv").write_text(text)
    return folder


def write_rows(folder, anchors, ranges, truth):
    """The files of anchors (n, 3), m, rows (time, anchor's row, range), and rows (time, x, y, z)."""
    tables = {
        "id,x,y,z": [(number, *place) for number, place in enumerate(anchors)],
        "t,anchor_id,range": sorted(ranges),
        "t,x,y,z": truth,
    }
    texts = ["\n".join([head, *(",".join(map(str, row)) for row in rows)]) for head, rows in tables.items()]
    return write(folder, *texts)


def scenario_of(folder, *overrides):
    base = ["target.motion=dataset", f'target.path="{folder}"', "network.graph=complete"]
    return load("tracking", [*base, *overrides]).scenario
