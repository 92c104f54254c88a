# SPDX-License-Identifier: Apache-2.0
"""Builds a LeRobotDataset out of demonstrations: takes in parallel processes, then one dataset of them all.

Everything unfinished stands in `<root>.unfinished`, which is no dataset to LeRobot:

    recipe.json         what is being built; another build does not mix with it
    takes/00012/        one complete take each, see `takes`
    joined/             datasets joined so far; made again after an interruption
"""

import contextlib
import hashlib
import io
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path
from typing import Any

import datasets
from filelock import FileLock, Timeout
from lerobot.annotations.steerable_pipeline.reader import iter_episodes
from lerobot.annotations.steerable_pipeline.staging import EpisodeStaging
from lerobot.annotations.steerable_pipeline.writer import LanguageColumnsWriter
from lerobot.datasets import LeRobotDatasetMetadata
from lerobot.datasets.aggregate import aggregate_datasets
from lerobot.datasets.io_utils import write_info, write_stats
from lerobot.datasets.language import EXTENDED_STYLES, PERSISTENT_STYLES, language_feature_info
from tqdm import tqdm

from builder_tools.recipe import differences, read_recipe, write_recipe
from builder_tools.workers import Workers, is_disk_full
from nico_tabletop.objects import TabletopObject
from nico_tabletop.scoring import Outcome

from .demonstrations import Demonstration
from .release import Split
from .takes import Studio, Take, complete_takes, make_take, read_take, remove_unfinished, unfinished_takes

_OWN_STYLES = {"translation", "scene"}
EXTENDED_STYLES.update(_OWN_STYLES)
PERSISTENT_STYLES.update(_OWN_STYLES)

_JOINED_AT_ONCE = 12
"""With each dataset that it appends, LeRobot rewrites all before; so many are joined in rounds."""


class BuildError(RuntimeError):
    """A build stopped before its end, or cannot begin; the message says what to do."""


def build_dataset(
    demonstrations: Sequence[Demonstration],
    objects: tuple[TabletopObject, ...],
    repo_id: str,
    root: Path,
    *,
    height: int,
    width: int,
    video: bool,
    keep_failures: bool,
    recipe: Mapping[str, Any],
    shard: tuple[int, int] = (1, 1),
    workers: int = 1,
    finish: Callable[[Path], None] = lambda root: None,
) -> Counter[Outcome]:
    """Replay `demonstrations` and write them to `root`, train episodes first and test episodes last.

    Called again after an interruption, it goes on after the last complete take. The tables are the same, byte
    for byte, however many workers made them and however often they were interrupted.

    Args:
        demonstrations: What to replay; at least one.
        objects: What the world has; at least what the demonstrations name.
        repo_id: The dataset's name on the Hub, such as `me/clant`.
        root: Folder to make.
        height: Rows of the images.
        width: Columns of the images.
        video: Store frames as video; as single images otherwise.
        keep_failures: Also write episodes whose replay fails.
        recipe: What tells this build from others, JSON values; a build goes on only with the same.
        shard: (i, n): the i-th, counted from 1, of n parts of the episodes. Joined in their order, the
            parts are the whole: test episodes still come last.
        workers: Parallel processes.
        finish: Called with the folder of the dataset before it is moved, to add its card.

    Returns:
        How many replays had which outcome.

    Raises:
        FileExistsError: If `root` exists.
        BuildError: If the build cannot begin, or stopped.
    """
    if root.exists():
        raise FileExistsError(f"{root} exists already; remove it or choose another folder with --root")
    part, parts = shard
    in_order = sorted(demonstrations, key=lambda demonstration: demonstration.split == "test")
    chosen = in_order[(part - 1) * len(in_order) // parts : part * len(in_order) // parts]
    if not chosen:
        raise BuildError(f"part {part} of {parts} has no episode: there are only {len(in_order)}")
    unfinished = root.with_name(f"{root.name}.unfinished")
    studio = Studio(unfinished / "takes", objects, height, width, video, keep_failures)
    with _reporting_interruptions(studio, len(chosen)):
        unfinished.mkdir(parents=True, exist_ok=True)
        with _alone_in(unfinished), Workers(min(workers, len(chosen))) as crew:
            _check_recipe(unfinished, studio, {**recipe, "look of the objects": _fingerprint(objects)})
            _make_takes(studio, chosen, crew)
            takes = [read_take(studio.take(index)) for index in range(len(chosen))]
            dataset = _join_takes(takes, repo_id, unfinished / "joined", crew)
            finish(dataset)
            dataset.rename(root)
            shutil.rmtree(unfinished)
    return Counter(take.outcome for take in takes)


def _fingerprint(objects: tuple[TabletopObject, ...]) -> str:
    """A file of objects may change between two runs of the same command."""
    return hashlib.sha256(repr(objects).encode()).hexdigest()[:12]


def _check_recipe(unfinished: Path, studio: Studio, recipe: Mapping[str, Any]) -> None:
    """Write down what is being built, or compare with what was begun here, if any of it is worth keeping."""
    begun = read_recipe(unfinished)
    if begun is None or not any(complete_takes(studio.folder)):
        write_recipe(unfinished, recipe)
    elif differing := differences(begun, recipe, dict.fromkeys([*begun, *recipe])):
        raise BuildError(
            f"{unfinished} holds an unfinished build of something else: {differing}. Give the same command "
            "to go on, or delete that folder to start afresh."
        )


def _make_takes(studio: Studio, demonstrations: Sequence[Demonstration], crew: Workers) -> None:
    remove_unfinished(studio.folder)
    missing = [
        (index, demonstration)
        for index, demonstration in enumerate(demonstrations)
        if not studio.take(index).exists()
    ]
    frames = 0
    done = len(demonstrations) - len(missing)
    with tqdm(total=len(demonstrations), initial=done, desc="Replaying", unit="episode") as bar:
        for count in crew.run(partial(make_take, studio), missing):
            frames += count
            bar.set_postfix_str(f"{frames / bar.format_dict['elapsed']:.0f} frames/s", refresh=False)
            bar.update()


def _join_takes(takes: Sequence[Take], repo_id: str, folder: Path, crew: Workers) -> Path:
    """One dataset of all takes, with language, splits and statistics; its folder."""
    kept = [take for take in takes if take.dataset is not None]
    if not kept:
        raise BuildError("no demonstration succeeded, so there is nothing to write")
    shutil.rmtree(folder, ignore_errors=True)
    parts = [take.dataset for take in kept if take.dataset is not None]
    level = 0
    while level == 0 or len(parts) > 1:
        groups = [parts[at : at + _JOINED_AT_ONCE] for at in range(0, len(parts), _JOINED_AT_ONCE)]
        targets = [folder / str(level) / f"{index:04d}" for index in range(len(groups))]
        jobs = list(zip(groups, targets, strict=True))
        done = crew.run(partial(_join, repo_id), jobs)
        for _ in tqdm(done, total=len(jobs), desc=f"Joining, round {level + 1}", unit="group"):
            pass
        if level > 0:
            shutil.rmtree(folder / str(level - 1))
        parts, level = targets, level + 1
    [dataset] = parts
    with _scratch(folder):
        _write_language(dataset, [take.language for take in kept])
        meta = LeRobotDatasetMetadata(repo_id, root=dataset)
        meta.info.features.update(language_feature_info())
        meta.info.splits = _splits([take.split for take in kept])
        write_info(meta.info, dataset)
        # LeRobot leaves them in an order that changes from run to run.
        write_stats(dict(sorted(meta.stats.items())), dataset)
    return dataset


def _splits(in_order: Sequence[Split]) -> dict[str, str]:
    """LeRobot's splits, `{"train": "0:9", "test": "9:12"}`; a shard may lack one."""
    train = in_order.count("train")
    ranges = {"train": (0, train), "test": (train, len(in_order))}
    return {name: f"{start}:{end}" for name, (start, end) in ranges.items() if start < end}


def _join(repo_id: str, group: tuple[Sequence[Path], Path]) -> None:
    sources, target = group
    with _scratch(target.parent), contextlib.redirect_stderr(io.StringIO()):  # three progress bars
        aggregate_datasets([repo_id] * len(sources), repo_id, list(sources), target)


def _write_language(root: Path, rows: Sequence[list[dict[str, Any]]]) -> None:
    """Fill the language columns with LeRobot's own writer, which reads one staged file per episode."""
    with tempfile.TemporaryDirectory() as staging:
        for index, episode_rows in enumerate(rows):
            EpisodeStaging(Path(staging), index).write("plan", episode_rows)
        LanguageColumnsWriter().write_all(list(iter_episodes(root)), Path(staging), root)


@contextlib.contextmanager
def _scratch(folder: Path) -> Iterator[None]:
    """LeRobot's temporary files and its cache of each table that it opens go below `folder`, and are removed.

    A killed build would leave them in the system's own places for good.
    """
    folder.mkdir(parents=True, exist_ok=True)
    before = tempfile.tempdir, datasets.config.HF_DATASETS_CACHE
    scratch = tempfile.mkdtemp(dir=folder, prefix="scratch-")
    tempfile.tempdir, datasets.config.HF_DATASETS_CACHE = scratch, Path(scratch)
    try:
        yield
    finally:
        tempfile.tempdir, datasets.config.HF_DATASETS_CACHE = before
        shutil.rmtree(scratch, ignore_errors=True)


@contextlib.contextmanager
def _alone_in(unfinished: Path) -> Iterator[None]:
    """Two builds in one folder would remove each other's takes; the lock ends with its process."""
    try:
        with FileLock(unfinished / "lock", timeout=0):
            yield
    except Timeout:
        raise BuildError(f"another process is building in {unfinished}; let it finish first") from None


@contextlib.contextmanager
def _reporting_interruptions(studio: Studio, total: int) -> Iterator[None]:
    try:
        yield
    except BrokenProcessPool:
        begun = " or ".join(str(index) for index in unfinished_takes(studio.folder))
        doing = f"while making episode {begun}" if begun else "between two episodes"
        why = f"a worker process died {doing} (killed, or out of memory?)"
        hint = "fewer --workers take less memory"
        raise BuildError(_interruption(studio, total, why, hint)) from None
    except Exception as error:
        if not is_disk_full(error):
            raise
        raise BuildError(_interruption(studio, total, "the disk is full", "make room first")) from None


def _interruption(studio: Studio, total: int, why: str, hint: str) -> str:
    complete = sum(studio.take(index).exists() for index in range(total))
    return (
        f"{why}. Nothing is lost: {complete} of {total} episodes are complete in {studio.folder.parent}. "
        f"Run the same command again to go on from there; {hint}."
    )
