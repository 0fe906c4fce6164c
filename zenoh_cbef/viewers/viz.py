"""A run for Foxglove, Lichtblick and Rerun: an MCAP file of what these draw, and a layout for it."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from zenoh_cbef import __version__
from zenoh_cbef.log.mcap.writer import McapWriter
from zenoh_cbef.viewers.colours import LAYOUT
from zenoh_cbef.viewers.drawing import Drawing
from zenoh_cbef.viewers.scene import Scene
from zenoh_cbef.writing import whole


def write_viz(scene: Scene, output: Path) -> list[Path]:
    """Write the file, and a layout for it beside; returns both. Raises UserError where they cannot be written."""
    drawing = Drawing(scene)
    layout = output.with_name(f"{output.stem}-layout.json")
    with whole(output) as fresh, McapWriter(fresh, library=f"zenoh-cbef {__version__}") as writer:
        writer.add_metadata("cbef.viz", {"run": scene.trace.name, "version": __version__})
        _write(drawing, scene, writer)
    with whole(layout) as fresh:
        fresh.write_text((files("zenoh_cbef.viewers") / LAYOUT).read_text(encoding="utf-8"), encoding="utf-8")
    return [output, layout]


def _write(drawing: Drawing, scene: Scene, writer: McapWriter) -> None:
    schemas: dict[str, int] = {}
    channels: dict[str, int] = {}
    for sequence, (time, topic, make) in enumerate(drawing.messages(scene)):
        if topic not in channels:
            kind = drawing.topics[topic]
            name = kind.DESCRIPTOR.full_name
            if name not in schemas:
                schemas[name] = writer.register_schema(name, "protobuf", drawing.schema_of(kind))
            channels[topic] = writer.register_channel(topic, "protobuf", schemas[name])
        writer.add_message(channels[topic], time, time, sequence, make().SerializeToString())
