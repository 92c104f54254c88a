# SPDX-License-Identifier: Apache-2.0
"""What is being made in a folder, so that another command does not go on with it."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

RECIPE = "recipe.json"


def read_recipe(folder: Path) -> dict[str, Any] | None:
    """What was begun in a folder; None if nothing is noted there."""
    file = folder / RECIPE
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else None


def write_recipe(folder: Path, recipe: Mapping[str, Any]) -> None:
    """Note what is made in a folder, JSON values; a crash leaves the old note or the new one."""
    file = folder / RECIPE
    draft = file.with_suffix(".draft")
    draft.write_text(json.dumps(recipe, indent=2), encoding="utf-8")
    draft.rename(file)


def differences(begun: Mapping[str, Any], recipe: Mapping[str, Any], keys: Iterable[str]) -> str:
    """In which of these keys a recipe is not what was begun, in words; empty if in none."""
    now = json.loads(json.dumps(recipe))
    return ", ".join(
        f"{key} was {begun.get(key)}, is now {now.get(key)}" for key in keys if begun.get(key) != now.get(key)
    )
