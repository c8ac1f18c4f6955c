"""Runs as data: errors, datasets, summaries, and the directory of a run."""
