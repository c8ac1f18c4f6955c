"""Where models, scenarios and studies are: inside an installed package, or at the top of the repository."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
_INSTALLED = {"studies": "studies/shipped"}  # mjsheaf/studies is a package of its own


def resource_directory(name: str) -> Path:
    """Directory of the files that come with mjsheaf.

    Args:
        name: 'models', 'scenarios' or 'studies'.
    """
    installed = _PACKAGE / _INSTALLED.get(name, name)
    return installed if installed.is_dir() else _PACKAGE.parent / name


def list_studies() -> dict[str, Path]:
    """The study files that come with mjsheaf: name to file."""
    return {path.stem: path for path in sorted(resource_directory("studies").glob("*.yaml"))}
