"""Numbers on their way to a page: JSON with arrays, as `scene/packed.js` reads it, and the same inside an HTML file."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping

import numpy as np

from zenoh_cbef.arrays import Floats


def framed(told: Mapping[str, object], arrays: Mapping[str, Floats] | None = None) -> bytes:
    """A message to a page: length of the JSON (uint32, little-endian), the JSON, numbers as little-endian float32.

    The JSON has, as `arrays`, names and shapes of what follows; it ends on a multiple of four bytes.
    """
    given = arrays or {}
    layout = [(name, list(values.shape)) for name, values in given.items()]
    text = json.dumps({**told, "arrays": layout}, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    numbers = b"".join(np.ascontiguousarray(values, dtype="<f4").tobytes() for values in given.values())
    return len(text).to_bytes(4, "little") + text + numbers


def enclosed(data: bytes) -> str:
    """Bytes as text that stands in an HTML file: compressed, since browsers unpack gzip themselves, in base64."""
    return base64.b64encode(gzip.compress(data, mtime=0)).decode("ascii")
