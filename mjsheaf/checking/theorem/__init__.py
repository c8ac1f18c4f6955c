"""Theorem 1: constants along the targets' path, the region that proves itself, and the gain for a desired radius."""
