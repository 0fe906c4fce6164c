"""Nooploop LinkTrack: Node_Frame2 of the vendor's NLink protocol, with the distances that a node measured.

Source: the vendor's unpacker, https://github.com/nooploop-dev/nlink_unpack (nlink_linktrack_nodeframe2.c, nlink_utils.h
and nlink_utils.c): 0x55 0x04, the frame's length (2 bytes, little endian), role, id, system_time (4 bytes), 108 bytes
that are of no use here, then how many nodes follow, each of 13 bytes: role, id, distance (3 bytes, mm, signed), and 8
more; the last byte is the sum of all others. system_time is taken to be in milliseconds: the unpacker does not say.
"""

from __future__ import annotations

import struct

from zenoh_cbef.nodes.receiver.ranged import Found, Ranged, plausible

_BEGIN = b"\x55\x04"
_FIXED, _NODE = 119, 13
_TIME, _COUNT = 6, 118


class LinkTrack:
    """Anchors are named by the ids of the nodes, as "0", "1"."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> Found:
        """The distances of all frames that are complete and whose sum is right."""
        rest, found, other = self._rest + data, list[Ranged](), 0
        while (at := rest.find(_BEGIN)) >= 0:
            rest = rest[at:]
            if len(rest) < 4:
                break
            (length,) = struct.unpack_from("<H", rest, 2)
            sound = length > _FIXED and (length - _FIXED - 1) % _NODE == 0
            if sound and len(rest) < length:
                break
            if sound and sum(rest[: length - 1]) % 256 == rest[length - 1]:
                found += _ranges(rest[:length])
                rest = rest[length:]
            else:  # these two bytes stand inside another frame, or something was lost
                other += 1
                rest = rest[len(_BEGIN) :]
        self._rest = rest if rest.startswith(_BEGIN) else rest[-1:]
        return Found(plausible(found), other)

    def finish(self) -> Found:
        """Nothing: a frame may be in two datagrams."""
        return Found([], 0)

    def forget(self) -> None:
        """A frame that has begun is lost."""
        self._rest = b""


def _ranges(frame: bytes) -> list[Ranged]:
    (milliseconds,) = struct.unpack_from("<I", frame, _TIME)
    starts = range(_FIXED, _FIXED + _NODE * min(frame[_COUNT], (len(frame) - _FIXED - 1) // _NODE), _NODE)
    time = milliseconds / 1e3  # not times 1e-3, which is no float: as decimals are read
    return [Ranged(time, str(frame[at + 1]), _signed(frame[at + 2 : at + 5]) / 1e3) for at in starts]


def _signed(three: bytes) -> int:
    return int.from_bytes(three, "little", signed=True)
