# SPDX-License-Identifier: Apache-2.0
"""Fixtures that several test files share."""

from __future__ import annotations

import os
import subprocess
import sys
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from lerobot.datasets import LeRobotDataset

    from clant_claeo.release import Release

CLANT_DIR = "OWLXT5_CLANT_DIR"

if sys.platform == "linux":  # software rendering without a screen; must be set before mujoco is imported
    os.environ.setdefault("MUJOCO_GL", "egl")


os.environ["HF_HUB_OFFLINE"] = (
    "1"  # no test needs the network; must be set before huggingface_hub is imported
)


# A busy machine is slow, not wrong.
settings.register_profile("patient", deadline=None)
settings.load_profile("patient")


@pytest.fixture(autouse=True)
def no_process(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep the fast tier fast: what starts a process is marked `slow`."""
    if request.node.get_closest_marker("slow") is None:

        def refuse(*_: object, **__: object) -> None:
            raise AssertionError("this test starts a process: mark it with @pytest.mark.slow")

        monkeypatch.setattr(subprocess, "Popen", refuse)
        monkeypatch.setattr(BaseProcess, "start", refuse)


@pytest.fixture(scope="session")
def clant_dir() -> Path:
    """Folder of the original CLANT release; tests that need it are skipped without it."""
    if not (path := os.environ.get(CLANT_DIR)):
        pytest.skip(f"needs the original CLANT release: set {CLANT_DIR} to its folder")
    return Path(path)


@pytest.fixture(scope="session")
def clant_release(clant_dir: Path) -> Release:
    """The original release, read and checked."""
    from clant_claeo.release import read_release  # imports mujoco: after MUJOCO_GL is set

    return read_release(clant_dir)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> LeRobotDataset:
    """A dataset of three short episodes; a module that changes it hurts no other."""
    from policy_helpers import make_dataset  # imports huggingface_hub: after HF_HUB_OFFLINE is set

    return make_dataset(tmp_path_factory.mktemp("dataset") / "data", episodes=3)


@pytest.fixture(scope="module")
def t5(tmp_path_factory: pytest.TempPathFactory, dataset: LeRobotDataset) -> Path:
    """A tiny T5 whose tokenizer fits the dataset."""
    from policy_helpers import make_t5

    return make_t5(tmp_path_factory.mktemp("t5"), dataset.root)
