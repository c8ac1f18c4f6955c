"""Compilation: what compiles functions, keeps their machine code, and leaves out what a run has not."""
