"""Tests of the measurements, and of what start-up may load."""
