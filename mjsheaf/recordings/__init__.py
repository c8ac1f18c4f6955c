"""Positions of targets out of tables, netCDF and logs, for the motion `recorded`."""
