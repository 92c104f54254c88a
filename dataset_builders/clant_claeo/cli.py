# SPDX-License-Identifier: Apache-2.0
"""`owlxt5-dataset`: make CLANT, CLAEO, or the like with other objects, as a LeRobotDataset."""

import os
import shlex
import sys
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from lerobot.datasets import LeRobotDatasetMetadata
from lerobot.utils.constants import HF_LEROBOT_HOME
from rich.console import Console

from builder_tools.workers import quiet, usable_cores
from lerobot_owlxt5.command_line import check_numbers, command
from nico_tabletop.drawing import DrawingError, check_image_size
from nico_tabletop.objects import read_objects
from nico_tabletop.scoring import Outcome
from nico_tabletop.variation import Variation

from .builder import BuildError, build_dataset
from .card import Build, as_words, read_build, train_command, write_card
from .demonstrations import Demonstration, from_release, scripted
from .hub import HubError, create_repository, upload
from .release import read_release


@dataclass
class DatasetConfig:
    """Make CLANT (coloured cubes) or CLAEO (everyday objects) as a LeRobotDataset with camera frames."""

    # Objects on the table: a shipped set (`clant`, `claeo`, `household`) or a YAML file.
    objects: str = "clant"
    # The folder CLANT of the original release, or `scripted` for the built-in expert (needs no download).
    source: str = "scripted"
    # Where the scripted expert's objects stand: on the `slots`; `free`: anywhere in reach, at any yaw;
    # `mixed`: half of the demonstrations so, half so.
    placement: str = "slots"
    # How much each demonstration may differ from the paper's setting, such as `--variation.arms_deg=5`.
    variation: Variation = field(default_factory=Variation)
    # Share of the scripted demonstrations that begin where another movement left the object and the arms.
    follow_ups: float = 0.0
    # Seed of the free placement, of the variation, of what comes before, and of the sentences to translate.
    seed: int = 0
    # Name on the Hub; `local/<objects>` when unset.
    repo_id: str | None = None
    # Folder to make; LeRobot's own place for `repo_id` when unset.
    root: Path | None = None
    # Take only so many of the 120 arrangements, spread over all objects, with all twelve actions each.
    arrangements: int | None = None
    # Rows and columns of the images.
    height: int = 480
    width: int = 640
    # Store frames as video (small); false: as single images (faster to read at random).
    video: bool = True
    # `i/n`: build only the i-th of n parts of the episodes, a dataset of its own.
    shard: str | None = None
    # Parallel processes; as many as there are usable cores when unset.
    workers: int | None = None
    # Upload to the Hub as `repo_id`, after building it; what lies in `root` is not built again.
    push_to_hub: bool = False
    # Make the repository private; unset: only what is made from the release, which states no licence.
    private: bool | None = None

    @property
    def shown_objects(self) -> str:
        """The objects as a dataset's readers may see them: of a path in other folders the last part alone."""
        return f"path/to/{Path(self.objects).name}" if os.sep in self.objects else self.objects


# Options that say where a dataset goes and how fast it gets there, not what is in it.
_WITHOUT_EFFECT = {"repo_id", "root", "workers", "push_to_hub", "private"}


def _command(config: DatasetConfig) -> str:
    """The command that makes the same dataset elsewhere; of a path it has the name alone."""
    options: dict[str, Any] = {"objects": config.shown_objects}
    for option in fields(config):
        value = getattr(config, option.name)
        if option.name in _WITHOUT_EFFECT | {"objects"} or value == option.default:
            continue
        if option.name == "variation":
            options |= {f"variation.{name}": each for name, each in value.options().items()}
        else:
            options[option.name] = "path/to/CLANT" if option.name == "source" else value
    return shlex.join(["owlxt5-dataset", *as_words(options)])


def _demonstrations(config: DatasetConfig) -> list[Demonstration]:
    if config.source == "scripted":
        found = list(
            scripted(config.objects, config.placement, config.seed, config.variation, config.follow_ups)
        )
    elif config.follow_ups:
        raise ValueError("the release's movements begin at rest: --follow_ups needs --source=scripted")
    elif config.placement != "slots":
        raise ValueError("the release's trajectories fit its slots: --placement=free needs --source=scripted")
    else:
        release = read_release(config.source)
        found = list(from_release(release, config.objects, config.variation, config.seed))
    if config.arrangements is None:
        return found
    known = list(dict.fromkeys(demonstration.arrangement for demonstration in found))
    if not 1 <= config.arrangements <= len(known):
        raise ValueError(f"--arrangements must lie between 1 and {len(known)}; got {config.arrangements}")
    # The release's split repeats every four arrangements, so an even step could leave an action without any
    # training episode. Steps of 31 spread over all colours and over both splits.
    chosen = {known[31 * k % len(known)] for k in range(config.arrangements)}
    return [demonstration for demonstration in found if demonstration.arrangement in chosen]


def _shard(text: str | None) -> tuple[int, int]:
    if text is None:
        return 1, 1
    part, slash, parts = text.partition("/")
    if not (slash and part.isdecimal() and parts.isdecimal() and 1 <= int(part) <= int(parts)):
        raise ValueError(f"--shard must be i/n with i from 1 to n, such as 2/4; got {text!r}")
    return int(part), int(parts)


def _check(config: DatasetConfig) -> None:
    """Refuse before anything is made what libraries would refuse in the middle of it."""
    check_image_size(config.height, config.width)
    if not 0 <= config.follow_ups <= 1:
        raise ValueError(f"--follow_ups is a share from 0 to 1; got {config.follow_ups}")
    if config.video and (config.height % 2 or config.width % 2):
        raise ValueError(
            f"--height and --width of a video must be even; got {config.height} and {config.width} "
            "(--video=false stores images of any size)"
        )
    check_numbers(config, "workers")


def _build(config: DatasetConfig, repo_id: str, root: Path, record: Build, console: Console) -> None:
    workers = usable_cores() if config.workers is None else config.workers
    shard = _shard(config.shard)
    demonstrations = _demonstrations(config)
    if config.push_to_hub:
        _prepare_push(config, record, repo_id)
    kind = "the original release" if record.release else "the scripted expert"
    console.print(f"{len(demonstrations)} demonstrations of {kind} on {record.name}")
    outcomes = build_dataset(
        demonstrations,
        read_objects(config.objects),
        repo_id,
        root,
        height=config.height,
        width=config.width,
        video=config.video,
        # The release is kept whole; a script that failed demonstrates nothing.
        keep_failures=record.release,
        recipe=asdict(record),
        shard=shard,
        workers=workers,
        finish=lambda folder: write_card(folder, repo_id, record),
    )
    console.print("Replays: " + ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items()))
    if not record.release:
        rejected = outcomes[Outcome.FAILURE]
        console.print(f"Rejected and not written: {rejected} of {outcomes.total()} demonstrations")


def _prepare_push(config: DatasetConfig, record: Build, repo_id: str) -> None:
    """Fail before hours of building and not after them, if the Hub will not take the dataset."""
    if "/" not in repo_id or config.repo_id is None:
        raise ValueError(f"--push_to_hub=true needs --repo_id=<your name on the Hub>/{record.name}")
    create_repository(repo_id, private=_private(config))


def _private(config: DatasetConfig) -> bool:
    return config.source != "scripted" if config.private is None else config.private


@command("owlxt5-dataset", BuildError, DrawingError, HubError, ModuleNotFoundError)
def _make(config: DatasetConfig) -> None:
    _check(config)
    console = Console()
    record = Build(
        config.shown_objects,
        config.placement,
        config.source != "scripted",
        _command(config),
        variation=config.variation.options(),
        follow_ups=config.follow_ups,
    )
    repo_id = config.repo_id or f"local/{record.name}"
    root = config.root or HF_LEROBOT_HOME / repo_id
    built = read_build(root) if config.push_to_hub else None
    if built is None:
        _build(config, repo_id, root, record, console)
    elif built.command == record.command:
        _prepare_push(config, record, repo_id)
        write_card(root, repo_id, built)
        console.print("The dataset is there already and is not built again")
    else:
        raise FileExistsError(
            f"{root} holds what another command made: {built.command}. Choose another --root"
        )
    if config.push_to_hub:
        console.print(f"Uploaded: {upload(root, repo_id)}", soft_wrap=True)
        if record.release:
            visible = "It is private" if _private(config) else "Be sure that you may share it"
            console.print(f"{visible}: the release states no licence for its data (--private)")
    console.print(f"Dataset: {root}", soft_wrap=True)
    if training := train_command(LeRobotDatasetMetadata(repo_id, root=root), root):
        console.print(f"Next: {training}", soft_wrap=True, markup=False)


def main() -> None:
    """Entry point; an error that the user can mend ends in one message and exit status 1."""
    quiet()
    try:
        _make()
    except KeyboardInterrupt:
        print("\nowlxt5-dataset: interrupted; the same command goes on after the last complete episode")
        sys.exit(130)


if __name__ == "__main__":
    main()
