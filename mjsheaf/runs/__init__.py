"""Simulation of runs, and their directories.

Modules: simulate (one run, or many), publish (the directory, written atomically; figures and pages in Python),
diagnostics (notes about a run), expecting (`expect:` blocks), overlay (`compare-runs`).
"""
