"""Runs as logs that other tools open: MCAP with Foxglove's schemas, and bags of ROS 2."""

from mjsheaf.export.log import FORMATS, export_run, require_installed

__all__ = ["FORMATS", "export_run", "require_installed"]
