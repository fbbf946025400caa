"""Measured data sets: what is known of each, where it is, and the maps that read its logs.

A folder a data set: `dataset.toml` (origin, licence, checksums, which map reads which file) and the maps. Code never
knows one set from another.
"""

from sinan.experiments.datasets.inputs import called, convert, kept_map_of, log_of, resolve
from sinan.experiments.datasets.registry import DataFile, Dataset, dataset_names, load_dataset

__all__ = [
    "DataFile",
    "Dataset",
    "called",
    "convert",
    "dataset_names",
    "kept_map_of",
    "load_dataset",
    "log_of",
    "resolve",
]
