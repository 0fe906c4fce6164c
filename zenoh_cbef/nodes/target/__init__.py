"""The target process: it emits the beacons, begins, watches and ends the run."""
