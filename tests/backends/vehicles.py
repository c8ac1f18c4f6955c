"""Copies of the models/ vehicles with something about them changed, and rotations to try them at."""

from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mjsheaf.vehicles.loading import list_vehicles

Array = NDArray[np.float64]
Edit = Callable[[ElementTree.Element], None]


def find(root: ElementTree.Element, path: str) -> ElementTree.Element:
    """The one element at a path."""
    element = root.find(path)
    assert element is not None, path
    return element


def xml_of(name: str) -> ElementTree.Element:
    """The MJCF of a vehicle in models/."""
    return ElementTree.parse(list_vehicles()[name].with_suffix(".xml")).getroot()


def altered(folder: Path, name: str, edit: Edit | None = None, **description: Any) -> str:
    """Write a copy of a vehicle with its MJCF edited and fields of its description replaced; give its path."""
    folder.mkdir(parents=True, exist_ok=True)
    root = xml_of(name)
    if edit is not None:
        edit(root)
    (folder / f"{name}.xml").write_text(ElementTree.tostring(root, encoding="unicode"))
    fields = yaml.safe_load(list_vehicles()[name].read_text())
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump({k: v for k, v in {**fields, **description}.items() if v is not None}))
    return str(path)


def attitudes(count: int, seed: int = 0) -> Array:
    """Random attitudes, body to world, shape (count, 3, 3)."""
    return Rotation.random(count, random_state=seed).as_matrix()


def yaws(count: int, seed: int = 0) -> Array:
    """Random level attitudes, body to world, shape (count, 3, 3)."""
    angles = np.random.default_rng(seed).uniform(-4, 4, count)
    return Rotation.from_rotvec(np.outer(angles, [0.0, 0.0, 1.0])).as_matrix()
