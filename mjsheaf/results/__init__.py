"""Runs as data: errors, datasets, summaries, and the directory of a run."""

from mjsheaf.results.dataset import join, make_datasets
from mjsheaf.results.metrics import check_expectation, summarize
from mjsheaf.results.store import dataset_bytes, open_dataset, open_run, staging, thinned, write_dataset

__all__ = [
    "check_expectation",
    "dataset_bytes",
    "join",
    "make_datasets",
    "open_dataset",
    "open_run",
    "staging",
    "summarize",
    "thinned",
    "write_dataset",
]
