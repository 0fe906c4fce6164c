"""`python -m benchmarks [NAME...]`: measured values beside their targets; asserts nothing."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Iterable
from pathlib import Path
from typing import Protocol, cast

from rich.console import Console
from rich.table import Table

from benchmarks.common import interrupt_on_terminate
from zenoh_cbef.errors import UserError


class Benchmark(Protocol):
    """What every module named below has."""

    def run(self, repeats: int, **options: Path | float | str | None) -> Iterable[Table]:
        """Measure, timed parts `repeats` times, and yield tables as they are done. Few have options."""


BENCHMARKS = {
    "accuracy": ("accuracy", "errors against the centralised filter, NEES, outliers, the paper's figures"),
    "lockstep": ("lockstep", "rounds per second of real agents against a bare exchange, 6 and 24 agents"),
    "round": ("round", "rounds per second against a bare exchange, by recorder; a round's CPU by process and place"),
    "rivals": ("rivals", "rounds per second of the same consensus loop over ZeroMQ, MPI and Unix sockets, beside ours"),
    "realtime": (
        "realtime",
        "the highest step rate that realtime runs keep, 6 and 24 agents, and latencies; --set KEY=VALUE",
    ),
    "step": ("step", "what a lockstep step and a round cost an agent: Python calls, CPU of its main thread"),
    "startup": ("startup", "seconds to the first step, CPU of a simulation and of idle agents"),
    "rejoin": ("rejoin", "how soon all is as before after a crash and after a cut"),
    "joins": ("joins", "100 random joins, leaves, deaths and moves of agents by hand: links from sockets, tokens"),
    "recorder": ("recorder_cost", "what the recorder costs the agents, over Zenoh and with rings"),
    "ring-soak": ("ring_soak", "recorders and agents killed with all cores busy: what their rings lose; --kills 200"),
    "mcap": ("mcap_speed", "the log's writer and reader against the public library's"),
    "logs": ("log_speed", "a log of a million messages analysed and described; writing, 200-byte messages"),
    "fuzz": ("fuzz", "a million mutated messages, keys and texts through every decoder, 250 logs through every verb"),
    "kills": ("kills", "200 recorders killed at random moments: what their logs lack"),
    "smoothing": ("smoothing", "what smoothing gains, with which lag, against a centralised smoother, 50 seeds"),
    "beginning": ("beginning", "how sure a network is of itself in its first steps, and how good, 200 seeds"),
    "robust": ("robust", "what sensors and agents that fail cost, 50 seeds"),
    "design": ("design", "errors that `zenoh-cbef design` predicts, against simulations"),
    "filters": ("filters", "every filter, 50 seeds and recorded data; --write docs/filters.md --data FOLDER"),
    "recorded": ("recorded", "recorded ranges, with biases left alone, estimated and weighed, and other settings"),
    "held-out": ("held_out", "made-up sets of the same kinds, with known biases"),
    "random-sets": (
        "random_sets",
        "sets drawn at random, beside a centralised prototype; --seeds 50, --first 1001, --set",
    ),
    "faults": ("random_faults", "200 random fault scenarios as processes, each proved by verify"),
    "fault-cost": ("fault_cost", "what faults cost a round of a scenario that has none"),
    "stress": ("stress", "scenarios that lose trackers; --case NAME, --seeds 50, --set filter.defaults=8"),
    "parted": ("parted", "groups of honest agents that only a liar links; --seeds 50"),
    "motions": ("several_motions", "how sure filters of several motions are of themselves, and others; --seeds 10"),
    "scale": ("scale", "links, messages, bytes and memory of n agents: formulas, counted runs; --agents 24,100"),
    "large": ("large", "simulations of 1000 to 100 000 agents: seconds of a step, memory, how both grow; --million"),
    "lab": ("lab", "the lab in headless Chromium: frames, from click to log, what a page costs a run, long logs"),
    "pictures": ("pictures", "not measured: the screenshots of the documentation, taken anew into docs/images"),
    "bytes": (
        "bytes",
        "error against bytes on a link, by filter, L, precision and trigger; tables and figure of docs/bytes.md",
    ),
    "seeds": ("seeds", "1000 seeds, clean and lossy: CPU, the bits of single runs; beside Stone Soup and FilterPy"),
    "sessions": ("sessions", "1200 sessions at one target"),
    "hosts": ("hosts", "agents on ten virtual hosts: start, links, memory, traffic, rate; --agents 100,300, as root"),
    "sites": ("sites", "two sites on virtual hosts, a router each, and a cut between them; as root"),
    "soak": ("soak", "memory of every process of a realtime run over time; --minutes 60"),
    "method": ("method_figures", "the figures of docs/method.md, written to docs/figures, and their numbers"),
}

_OPTIONS = {
    "filters": ("data", "write"),
    "held-out": ("case", "set"),
    "random-sets": ("seeds", "first", "set"),
    "scale": ("agents",),
    "large": ("million",),
    "hosts": ("agents",),
    "realtime": ("set",),
    "ring-soak": ("minutes", "kills"),
    "soak": ("minutes",),
    "parted": ("seeds", "first"),
    "motions": ("seeds", "first"),
    "stress": ("case", "seeds", "search", "first", "set"),
}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="which to run; default: all")
    parser.add_argument("--list", action="store_true", help="name them and stop")
    parser.add_argument("--repeats", type=int, default=5, help="how often what is timed is repeated")
    parser.add_argument("--data", type=Path, help="filters: the folder that holds the recorded sets")
    parser.add_argument("--minutes", type=float, default=10.0, help="soak, ring-soak: how long the run is, after kills")
    parser.add_argument("--kills", type=int, default=200, help="ring-soak: how many recorders, and agents, are killed")
    parser.add_argument("--case", help="stress, held-out: the one case to run; default: all")
    parser.add_argument("--seeds", type=int, default=50, help="stress, parted, motions, random-sets: how many seeds")
    parser.add_argument("--agents", help="scale, hosts: how many agents runs have; default: 24,100 and 100")
    parser.add_argument("--million", action="store_true", help="large: a million agents, too")
    parser.add_argument("--first", type=int, default=1001, help="stress, parted, motions, random-sets: the first seed")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="stress, realtime, held-out, random-sets: a key; may be repeated",
    )
    parser.add_argument("--search", type=int, default=0, help="stress: try so many random cases, keep what it finds")
    parser.add_argument("--write", type=Path, help="filters: the page to bring up to date")
    arguments = parser.parse_args()
    # Tables that are piped into a file keep their columns.
    console = Console(highlight=False, width=None if Console().is_terminal else 150)
    if arguments.list:
        for name, (_, description) in BENCHMARKS.items():
            print(f"{name:<10} {description}")
        return
    unknown = [name for name in arguments.names if name not in BENCHMARKS]
    if unknown or arguments.repeats < 1:
        parser.error(f"there is no benchmark {unknown[0]!r}; see --list" if unknown else "--repeats must be 1 or more")
    if arguments.seeds < 1:
        parser.error("--seeds must be 1 or more")
    interrupt_on_terminate()
    for name in arguments.names or BENCHMARKS:
        benchmark = cast("Benchmark", importlib.import_module(f"benchmarks.{BENCHMARKS[name][0]}"))
        options = _OPTIONS.get(name, ())
        try:
            for table in benchmark.run(arguments.repeats, **{option: getattr(arguments, option) for option in options}):
                console.print(table)
        except UserError as error:
            parser.error(str(error))


if __name__ == "__main__":
    main()
