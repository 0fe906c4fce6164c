"""The parts that every process of a run has: its place on the network, inboxes, the scenario from the target."""
