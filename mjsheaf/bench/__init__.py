"""Measurements of how fast mjsheaf is, each a function that returns a record; `benchmarks/` has scripts for them."""
