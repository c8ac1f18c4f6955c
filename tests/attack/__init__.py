"""Attacks on the program: what a disk, a user, a signal or a strange machine may do to it."""
