"""Messages as receivers send them."""

import struct

from zenoh_cbef.extras import from_extra

development = from_extra("pymavlink.dialects.v20.development", "MAVLink")
LINK = development.MAVLink(None)


def linktrack_frame(ms: int, distances: dict[int, int]) -> bytes:
    """A Node_Frame2 of the tag 0 at a time (ms), with distances (mm) to anchors."""
    body = struct.pack("<HBBI", 119 + 13 * len(distances) + 1, 2, 0, ms) + bytes(108) + bytes([len(distances)])
    for anchor, mm in distances.items():
        body += bytes([1, anchor]) + mm.to_bytes(3, "little", signed=True) + bytes(8)
    frame = b"\x55\x04" + body
    return frame + bytes([sum(frame) % 256])


def mavlink_message(ms: int, anchor: int, mm: int) -> bytes:
    """A RANGING_BEACON."""
    message = development.MAVLink_ranging_beacon_message(1000 * ms, 1, 1, anchor, mm, 0, 0, 0.0, 0, 0, 0, 0, 0, 0, 0)
    return bytes(message.pack(LINK))
