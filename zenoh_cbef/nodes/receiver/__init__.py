"""The process that turns what real receivers say into beacons of a run."""
