"""The command line."""

from mjsheaf.cli.main import main

__all__ = ["main"]
