"""Sweeps of scenarios: varied keys, the runs of every cell, statistics, verdict, figures."""
