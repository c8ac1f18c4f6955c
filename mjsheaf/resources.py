"""Where models and scenarios are: inside an installed package, or at the top of the repository."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def resource_directory(name: str) -> Path:
    """Directory of the files that come with mjsheaf.

    Args:
        name: 'models' or 'scenarios'.
    """
    installed = _PACKAGE / name
    return installed if installed.is_dir() else _PACKAGE.parent / name
