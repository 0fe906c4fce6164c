"""Recorded ranging data, in folders with anchors.csv, ranges.csv and, where the truth is known, truth.csv."""

from __future__ import annotations

from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.folder import read_dataset, write_dataset
from zenoh_cbef.datasets.recorded import dataset_folder

__all__ = ["Dataset", "dataset_folder", "read_dataset", "write_dataset"]
