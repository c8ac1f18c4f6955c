"""Theorem 1: its constants along the targets' path, the region that proves itself, and the gain for a wanted radius."""
