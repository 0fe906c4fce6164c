"""A figure of matplotlib that a notebook shows. It is imported where matplotlib is there."""

from __future__ import annotations

import io

from matplotlib.figure import Figure

_DPI = 150


class Picture(Figure):
    """A figure made without pyplot, which notebooks would name only."""

    def _repr_png_(self) -> bytes:
        """The figure as IPython shows it, a PNG."""
        file = io.BytesIO()
        self.savefig(file, format="png", dpi=_DPI)
        return file.getvalue()
