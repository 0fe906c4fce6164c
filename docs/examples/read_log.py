"""Read a log with nothing but mcap and msgpack: python read_log.py run.mcap."""

import struct
import sys
from pathlib import Path

import msgpack
from mcap.reader import make_reader

with Path(sys.argv[1]).open("rb") as stream:
    reader = make_reader(stream)
    for attachment in reader.iter_attachments():
        print(attachment.name, len(attachment.data), "bytes")
    last = {}
    for schema, channel, message in reader.iter_messages():
        body = msgpack.unpackb(message.data) if channel.message_encoding == "msgpack" else {}
        if schema.name == "cbef.Estimate":
            last[body["from"]] = body
    for agent, body in sorted(last.items()):
        covariance = struct.unpack("<36d", body["covariance"])  # 6 by 6, row by row
        deviations = [covariance[7 * axis] ** 0.5 for axis in range(3)]
        pairs = zip(body["state"][:3], deviations, strict=True)
        print(agent, "step", body["k"], *(f"{value:.3f}+-{deviation:.3f}" for value, deviation in pairs))
