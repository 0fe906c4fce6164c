"""Sweeps of scenarios: what is varied, every cell's runs, statistics, verdict, figures."""
