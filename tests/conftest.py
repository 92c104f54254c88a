# SPDX-License-Identifier: Apache-2.0
"""Fixtures that several test files share."""

import os
import sys
from pathlib import Path

import pytest

CLANT_DIR = "OWLXT5_CLANT_DIR"

if sys.platform == "linux":  # software rendering without a screen; must be set before mujoco is imported
    os.environ.setdefault("MUJOCO_GL", "egl")


@pytest.fixture(scope="session")
def clant_dir() -> Path:
    """Folder of the original CLANT release; tests that need it are skipped without it."""
    if not (path := os.environ.get(CLANT_DIR)):
        pytest.skip(f"needs the original CLANT release: set {CLANT_DIR} to its folder")
    return Path(path)
