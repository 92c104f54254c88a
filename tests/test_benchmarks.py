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


@pytest.mark.parametrize(
    ("name", "argument", "message"),
    [
        ("replay", "--objects=clant", "set OWLXT5_CLANT_DIR to its folder"),
        ("exactness", "--dataset_root=nowhere", "set OWLXT5_CLANT_DIR to its folder"),
        ("expert", "--objects=nowhere", "cannot read objects from 'nowhere'"),
        ("understanding", "--sentences=nowhere.tsv", "nowhere.tsv"),
    ],
)
def test_a_mistake_is_one_line(
    name: str, argument: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("OWLXT5_CLANT_DIR", raising=False)
    monkeypatch.syspath_prepend(FOLDER)
    monkeypatch.setattr(sys, "argv", [name, argument])
    try:
        with pytest.raises(SystemExit) as stopped:
            importlib.import_module(name).main()
    finally:
        sys.modules.pop(name, None)
    assert str(stopped.value).startswith(f"{name}: ")
    assert message in str(stopped.value)
    assert "\n" not in str(stopped.value)
