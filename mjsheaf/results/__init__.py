"""Runs as data: errors, datasets, summaries, and the directory that a run leaves behind."""

from mjsheaf.results.dataset import make_dataset
from mjsheaf.results.store import load_run, save_dataset, staging
from mjsheaf.results.summary import check_expectation, summarize

__all__ = ["check_expectation", "load_run", "make_dataset", "save_dataset", "staging", "summarize"]
