# SPDX-License-Identifier: Apache-2.0
"""What is typed after our commands, and what is said about mistakes in it."""

import ast
import shlex
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from clant_claeo.card import read_build, train_command
from clant_claeo.cli import DatasetConfig
from clant_claeo.cli import _check as check
from lerobot_owlxt5.backbones.small_t5 import main as small_t5
from lerobot_owlxt5.command_line import command, quote_texts
from lerobot_owlxt5.evaluation.cli import EvaluateConfig
from owlxt5_backbones.train import BackbonesConfig, keep_to_recipe
from owlxt5_backbones.train import main as backbones

ROOT = Path(__file__).resolve().parents[1]


@dataclass
class Inner:
    root: str | None = None
    episodes: list[int] | None = None


@dataclass
class Options:
    root: Path | None = None
    name: str = "none"
    height: int = 480
    workers: int | None = None
    dataset: Inner = field(default_factory=Inner)


seen: list[Options] = []


@command("example", LookupError)
def example(config: Options) -> None:
    """Note the options; some cannot be used."""
    seen.append(config)
    if config.height < 0:
        raise LookupError("there is no such height")


def start(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> Options:
    monkeypatch.setattr(sys, "argv", ["example", *arguments])
    example()
    return seen.pop()


@pytest.mark.parametrize(
    "name",
    [
        *(
            "20261126",
            "1e5",
            "1_000",
            "007",
            "0x10",
            "1.0",
            "2026-11-26",
            "null",
            "~",
            "true",
            "no",
            "%",
            "-",
        ),
        *("a: b", "a b", "[a]", "{}", "'a'", '"', "#1", "a #b", "*a", "&a", "!a", "tüte", "back\\slash"),
        "includes/data",
    ],
)
def test_any_name_is_a_folder(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    options = start(monkeypatch, f"--root={name}", "--name", name, f"--dataset.root={name}")
    assert options.root == Path(name)
    assert (Path(options.name), Path(options.dataset.root or "")) == (Path(name), Path(name))


def test_what_is_no_text_is_read_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    options = start(monkeypatch, "--height=12", "--workers=null", "--dataset.episodes=[1,2]")
    assert options == Options(height=12, dataset=Inner(episodes=[1, 2]))


@pytest.mark.parametrize(
    ("argument", "message"),
    [
        ("--height=abc", "--height: Couldn't parse 'abc' into an int"),
        ("--height=1.5", "--height"),
        ("--height=null", "--height needs a value"),
        ("--height=", "--height"),
        ("--height=[1", "flow sequence"),
        ("--height=include it", "it"),
        ("--workers=abc", "--workers"),
        ("--dataset.episodes=abc", "--dataset.episodes"),
        ("--config_path=/nowhere", "/nowhere"),
        ("--height=-1", "there is no such height"),
    ],
)
def test_a_mistake_is_one_line(monkeypatch: pytest.MonkeyPatch, argument: str, message: str) -> None:
    with pytest.raises(SystemExit) as stopped:
        start(monkeypatch, argument)
    assert str(stopped.value).startswith("example: ")
    assert message in str(stopped.value)
    assert "\n" not in str(stopped.value)


def test_lerobots_own_options_are_texts_too() -> None:
    given = ["--policy.path=1e5", "--dataset.root=1e5", "--output_dir=7", "--seed=7"]
    assert quote_texts(EvaluateConfig, given) == [
        *("--policy.path=1e5", '--dataset.root="1e5"', '--output_dir="7"', "--seed=7")
    ]


# owlxt5-dataset ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"height": 121}, "must be even"),
        ({"width": 161}, "must be even"),
        ({"height": 0}, "between 16 and 1920; got 0"),
        ({"width": -640}, "between 16 and 1920; got -640"),
        ({"height": 10**6, "video": False}, "between 16 and 1920"),
        ({"seed": -1}, "--seed must not be negative"),
        ({"workers": 0}, "--workers must be above 0; got 0"),
    ],
)
def test_what_a_library_would_refuse_later_is_refused_first(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        check(DatasetConfig(**options))


def test_odd_sizes_are_for_images() -> None:
    check(DatasetConfig(height=121, width=161, video=False))
    check(DatasetConfig())


@pytest.mark.parametrize("record", ['{"objects": "clant"}', '{"kind": "clant"}', "[]", "{", "\u00e9\udcff"])
def test_the_record_of_another_version_is_one_sentence(tmp_path: Path, record: str) -> None:
    assert read_build(tmp_path) is None
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "build.json").write_bytes(record.encode("latin-1", "replace"))
    with pytest.raises(ValueError, match=r"build.json is of another version of owlxt5-dataset: build"):
        read_build(tmp_path)


def test_the_printed_command_trains_on_the_train_split_and_quotes_paths() -> None:
    def printed(**splits: str) -> str | None:
        meta: Any = SimpleNamespace(repo_id="me/data", info=SimpleNamespace(splits=splits))
        return train_command(meta, Path("/my data/clant"))

    command = printed(train="0:36", test="36:48")
    assert command is not None
    # As a shell reads it.
    words = shlex.split(command)
    assert words[-2:] == ["--dataset.root=/my data/clant", "--dataset.episodes=[$(seq -s, 0 35)]"]
    assert printed(test="0:12") is None  # a part of a dataset


# The others -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("main", "arguments", "message"),
    [
        (small_t5, ("--output_dir=7", "--num_heads=0"), "small_t5: --num_heads must be above 0; got 0"),
        (
            small_t5,
            ("--output_dir=7", "--dataset_root=8"),
            "small_t5: --dataset_root=8 holds no LeRobotDataset",
        ),
        (backbones, ("--part=detector", "--output_dir=7", "--steps=0"), "--steps must be above 0; got 0"),
        (backbones, ("--part=detector", "--output_dir=7", "--images=-1"), "--images must be above 0; got -1"),
        (
            backbones,
            ("--part=detector", "--output_dir=7", "--seed=-1"),
            "--seed must not be negative; got -1",
        ),
        (backbones, ("--part=detector",), "output_dir"),
    ],
)
def test_so_do_the_other_commands(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    main: Callable[[], None],
    arguments: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["command", *arguments])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert message in str(stopped.value)
    assert not list(tmp_path.iterdir())


def test_what_training_needs_is_missed_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("owlxt5_backbones.muon.find_spec", lambda name: None)
    monkeypatch.setattr(sys, "argv", ["command", "--part=detector", "--output_dir=7"])
    with pytest.raises(SystemExit, match="owlxt5-backbones: making backbones needs timm: pip install"):
        backbones()
    assert not list(tmp_path.iterdir())


def test_a_folder_of_backbones_keeps_to_its_recipe(tmp_path: Path) -> None:
    config = BackbonesConfig("detector", tmp_path / "detector", steps=7)
    keep_to_recipe(replace(config, seed=3))  # made nothing
    keep_to_recipe(config)
    (config.output_dir / "images").mkdir()
    (config.output_dir / "images" / "00000.parquet").touch()
    for change, message in (({"seed": 1}, "seed was 0, is now 1"), ({"images": 48}, "images was 30000")):
        with pytest.raises(ValueError, match=message):
            keep_to_recipe(replace(config, **change))
    keep_to_recipe(replace(config, steps=8))  # the same images
    (config.output_dir / "checkpoints" / "checkpoint-5").mkdir(parents=True)
    keep_to_recipe(replace(config, steps=8))
    with pytest.raises(ValueError, match="steps was 8, is now 7; give the same command to go on"):
        keep_to_recipe(config)


def test_checkpoints_of_an_unknown_command_are_not_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["command", "--part=understanding", "--output_dir=7"])
    checkpoint = Path("7/checkpoints/checkpoint-500")
    checkpoint.mkdir(parents=True)
    with pytest.raises(SystemExit, match=r"owlxt5-backbones: 7 has checkpoints and no recipe\.json"):
        backbones()
    assert [*Path("7").iterdir()] == [checkpoint.parent]


# The locale -------------------------------------------------------------------------------------------------


def _opens_text(call: ast.Call) -> bool:
    """Whether a call opens a file as text; Pillow and PyAV open pictures and films."""
    function: Any = call.func
    name = getattr(function, "attr", getattr(function, "id", ""))
    return name in ("read_text", "write_text") or (
        name == "open" and ast.unparse(function) not in ("Image.open", "av.open")
    )


def test_no_text_file_depends_on_the_locale() -> None:
    """Ruff's rule knows only what it can infer to be a path."""
    missing = [
        f"{path.relative_to(ROOT)}:{call.lineno}"
        for folder in ("lerobot_owlxt5", "envs", "dataset_builders", "benchmarks")
        for path in (ROOT / folder).rglob("*.py")
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(call, ast.Call)
        and _opens_text(call)
        # What has a timeout is no file but an address.
        and not {"encoding", "mode", "timeout"} & {keyword.arg for keyword in call.keywords}
        and not any(isinstance(given, ast.Constant) and "b" in str(given.value) for given in call.args)
    ]
    assert not missing
