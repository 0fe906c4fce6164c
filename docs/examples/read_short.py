"""Read short consensus messages with nothing but mcap: python read_short.py run.mcap [numbers of a state]."""

import struct
import sys
from pathlib import Path

from mcap.reader import make_reader

states = int(sys.argv[2]) if len(sys.argv) > 2 else 6  # 4 in a plane
entries = states * (states + 1) // 2
with Path(sys.argv[1]).open("rb") as stream:
    for _, channel, message in make_reader(stream).iter_messages():
        if channel.message_encoding != "cbef.short":
            continue
        code, seq, sent, step, round_ = struct.unpack_from("<BIQIH", message.data)
        data, at = message.data[19:], f"{channel.topic} step {step} round {round_}:"
        bits, long = code & ~1, code & 1
        if bits not in (8, 12, 16):
            print(at, {1: "silence", 32: "float32", 64: "float64"}.get(code, "?"))
            continue
        powers, data = struct.unpack(f"{states}b", data[:states]), data[states:]
        size = -(-entries // 2) * 3 if bits == 12 else entries * bits // 8
        whole = struct.unpack_from(f"<{states}{'i' if long else 'h'}", data, size)
        state = [k / 32 / 2**e for k, e in zip(whole, powers, strict=True)]
        # The matrix's first entry: 2^(1-b) c 4^e, where c is the least significant b bits, with a sign.
        least = int.from_bytes(data[:2], "little") & ((1 << bits) - 1)
        first = (least - ((least >> (bits - 1)) << bits)) * 2.0 ** (1 - bits) * 4.0 ** powers[0]
        print(at, "x =", *(f"{one:.3f}" for one in state), "O_11 =", f"{first:.4g}")
