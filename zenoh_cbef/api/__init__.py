"""What Python programs import: runs that are made or read, and what they achieved. `import zenoh_cbef as zc` has it.

run: one run, with its numbers as arrays. plotting, frames: as figures and tables. simulating: without processes.
running: as processes. logs: from a log. live: while a run goes on.
"""
