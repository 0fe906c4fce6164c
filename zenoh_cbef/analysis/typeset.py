"""Files for papers: figures as PDF, SVG, PGF and PNG, tables as LaTeX and CSV; each says what made it."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

from zenoh_cbef import __version__
from zenoh_cbef.analysis.coverage import truth_steps
from zenoh_cbef.analysis.error_charts import error_charts
from zenoh_cbef.analysis.figures import paper_charts
from zenoh_cbef.analysis.metrics import Analysis
from zenoh_cbef.analysis.plots import time_plot
from zenoh_cbef.analysis.printed import drawn
from zenoh_cbef.extras import from_extra
from zenoh_cbef.pages.parts import Table
from zenoh_cbef.writing import make_folder, replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Format = Literal["pdf", "svg", "pgf", "png"]
FORMATS: tuple[Format, ...] = get_args(Format)
_DPI = 300
_WHAT = "the folder of figures"
_SPECIAL = {
    "\\": r"\textbackslash{}",
    **{one: f"\\{one}" for one in "&%$#_{}"},
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "²": r"\textsuperscript{2}",
    "ξ": r"$\xi$",
}


def write_figures(analysis: Analysis, folder: Path) -> list[Path]:
    """Write the paper's figures, one column wide, as innovation, msee and msee-average .png and .svg.

    Without a truth there is no MSEE: the position error that the covariances claim takes its place.
    Raises MissingExtra where matplotlib is not installed.
    """
    from_extra("matplotlib", _WHAT)
    make_folder(folder)
    written = []
    innovation, *errors = paper_charts(analysis)
    claimed, *_ = error_charts(analysis)
    for chart in (innovation, *(errors if truth_steps(analysis.trace).any() else (claimed,))):
        figure = drawn(time_plot(chart, analysis))
        written += [save(figure, folder / f"{chart.name}.{kind}", kind, chart.title) for kind in ("png", "svg")]
    return written


def save(figure: Figure, path: Path, kind: Format, title: str, command: str = "") -> Path:
    """Write a figure; title and command stand in the file's metadata, with the version.

    Raises OSError where it cannot be, and then leaves no half of it.
    """
    made = f"zenoh-cbef {__version__}"
    metadata: dict[str, dict[str, str | None]] = {
        "pdf": {"Title": title, "Creator": made, "Subject": command, "CreationDate": None, "ModDate": None},
        "svg": {"Title": title, "Creator": made, "Description": command, "Date": None},
        "png": {"Title": title, "Software": made, "Description": command},
    }
    same = from_extra("matplotlib", _WHAT).rc_context({"svg.hashsalt": "zenoh-cbef", "svg.fonttype": "path"})
    with same, replacing(path) as fresh:
        if kind == "pgf":
            fresh.write_text(_pgf(figure, [title, made, command]), encoding="utf-8")
        else:
            told = {name: value for name, value in metadata[kind].items() if value != ""}
            figure.savefig(data := io.BytesIO(), format=kind, dpi=_DPI, metadata=told)
            fresh.write_bytes(data.getvalue())  # Into a file, matplotlib's PDF fails on a full disk with another error.
    figure.set_layout_engine("none")  # The layout is that of the first file, and takes half of the time.
    return path


def _pgf(figure: Figure, told: Sequence[str]) -> str:
    r"""A figure as PGF commands, for \input in a LaTeX text.

    matplotlib's own way starts LaTeX to measure texts; here they are measured as for a picture of dots, so that no
    LaTeX is needed. LaTeX sets them in the fonts of the text.
    """
    pgf, agg = (
        from_extra("matplotlib.backends.backend_pgf", _WHAT),
        from_extra("matplotlib.backends.backend_agg", _WHAT),
    )
    text = io.StringIO()
    before, figure.dpi = figure.dpi, 72.0
    width, height = figure.get_size_inches()
    renderer = pgf.RendererPgf(figure, text)
    ruler = agg.RendererAgg(1, 1, figure.dpi)
    renderer.get_text_width_height_descent = ruler.get_text_width_height_descent
    for line in filter(None, told):
        text.write(f"% {line}\n")
    text.write("% In the preamble: \\usepackage{pgf}; then: \\input{THIS FILE}\n")
    text.write("\\begingroup%\n\\makeatletter%\n\\begin{pgfpicture}%\n")
    text.write(f"\\pgfpathrectangle{{\\pgfpointorigin}}{{\\pgfqpoint{{{width:f}in}}{{{height:f}in}}}}%\n")
    text.write("\\pgfusepath{use as bounding box, clip}%\n")
    try:
        figure.draw(renderer)
    finally:
        figure.dpi = before
    text.write("\\end{pgfpicture}%\n\\makeatother%\n\\endgroup%\n")
    return text.getvalue()


def latex(table: Table, command: str = "") -> str:
    r"""A table for a paper, with \usepackage{booktabs}: columns of words stand left, those of numbers right."""
    columns = zip(*table.rows, strict=True) if table.rows else ("" for _ in table.heads)
    places = "".join("l" if any(cell[:1].isalpha() for cell in column) else "r" for column in columns)
    lines = [f"% zenoh-cbef {__version__}" + (f": {command}" if command else "")]
    lines += [r"% In the preamble: \usepackage{booktabs}", rf"\begin{{tabular}}{{l{places[1:]}}}", r"\toprule"]
    if table.heads:
        lines += [_row(table.heads), r"\midrule"]
    lines += [*map(_row, table.rows), r"\bottomrule", r"\end{tabular}"]
    return "\n".join(lines) + "\n"


def _row(cells: Sequence[str]) -> str:
    text = " & ".join("".join(_SPECIAL.get(one, one) for one in cell) for cell in cells)
    # After the \\ or \midrule of the row above, these would be an option of it.
    return ("{}" if text.startswith(("[", "*")) else "") + text + r" \\"


def comma_separated(table: Table) -> str:
    """A table as CSV, its heads in the first line."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([table.heads, *table.rows] if table.heads else table.rows)
    return text.getvalue()
