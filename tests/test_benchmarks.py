# SPDX-License-Identifier: Apache-2.0
"""What the benchmarks take from the packages exists; they are run by hand."""

import importlib
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "benchmarks"


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.stem)
def test_a_benchmark_can_be_imported(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(FOLDER)
    try:
        module = importlib.import_module(path.stem)
    except ModuleNotFoundError as error:
        if error.name and error.name.partition(".")[0] in ("matplotlib", "timm"):
            pytest.skip(f"needs {error.name}")
        raise
    finally:
        sys.modules.pop(path.stem, None)
    assert module.__doc__
