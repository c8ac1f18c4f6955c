"""Simulation of runs, and their directories.

Modules: simulate, many (`simulate_many`), publish (the directory, written atomically;
figures and pages in Python), diagnostics (notes about a run), expecting (`expect:` blocks), overlay
(`compare-runs`), reflections (mirror images of a run), timings (durations).
"""
