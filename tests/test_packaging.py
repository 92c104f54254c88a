# SPDX-License-Identifier: Apache-2.0
"""What an installed package has: all modules, and all files that they read."""

import tomllib
from pathlib import Path

import pytest

from nico_tabletop.robot import NICO_XML
from nico_tabletop.scene import SCENE_XML

ROOT = Path(__file__).parents[1]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
FOLDERS = {package: ROOT / folder for package, folder in SETTINGS["package-dir"].items()}


@pytest.mark.parametrize("package", FOLDERS)
def test_every_file_is_shipped(package: str) -> None:
    patterns = SETTINGS["package-data"].get(package, [])
    shipped = {file for pattern in patterns for file in FOLDERS[package].glob(pattern)}
    files = {file for file in FOLDERS[package].rglob("*.*") if file.suffix not in (".py", ".pyc")}
    assert files == shipped
    if package == "nico_tabletop":
        assert {NICO_XML, SCENE_XML} <= shipped


def test_every_package_is_shipped() -> None:
    found = {
        ".".join([package, *file.parent.relative_to(folder).parts])
        for package, folder in FOLDERS.items()
        for file in folder.rglob("__init__.py")
    }
    assert found == {*SETTINGS["packages"]}
