"""Vehicles: what a vehicle file says, its MJCF, and its reduced model."""
