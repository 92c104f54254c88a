# SPDX-License-Identifier: Apache-2.0
"""Trains small policies from memory that differ in one thing, and tells how well each learns.

    data="--dataset_root=data/clant"
    python benchmarks/pairs.py $data --policy=owlxt5 --core=1 --output=pairs/1.json
    python benchmarks/pairs.py $data --policy=crosst5 --autoencoder=<checkpoint> --output=pairs/2.json
    python benchmarks/pairs.py $data --policy=owlxt5 --steps=20 --speed=true
    python benchmarks/pairs.py --table=pairs [--image=pairs.png]

Policy, modes and loss are the package's; there is no data loader. What is seen is computed once: for `owlxt5`
**the simulator's own boxes, an upper bound**, for `crosst5` the features of all frames. Seconds are those of
the processor, in one thread. Needs `pip install matplotlib`.
"""

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
import yaml
from lerobot.datasets import LeRobotDataset, LeRobotDatasetMetadata
from lerobot.optim.schedulers import CosineDecayWithWarmupSchedulerConfig
from lerobot.policies.factory import make_policy, make_policy_config
from lerobot.utils.constants import ACTION, OBS_STATE
from lerobot.utils.random_utils import set_seed
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from lerobot_owlxt5.autoencoder_features import FEATURE_NOISE, SMALLEST_RANGE
from lerobot_owlxt5.backbones.ground_truth import GroundTruthDetector
from lerobot_owlxt5.command_line import command
from lerobot_owlxt5.commands.parser import parse_command, spoken
from lerobot_owlxt5.configuration_owlxt5 import OBS_OBJECTS
from lerobot_owlxt5.evaluation.metrics import is_accepted, nrmse, squared_errors
from lerobot_owlxt5.scene import Found, Search, Thing
from lerobot_owlxt5.visual_encoder import MovedObjects, VisualInput

EVALUATIONS, SLOTS = 5, 20
FIGURES = ["execute", "nearest", "describe", "repeat"]
COLUMNS = ["step", "step_seconds", *FIGURES, "language_loss", "joint_loss", "norm", "largest_norm"]


@dataclass
class PairsConfig:
    """What to train; or with `speed` or `table` what to compare or show."""

    dataset_root: Path = Path("data/clant")
    policy: str = "owlxt5"  # or crosst5
    autoencoder: str | None = None  # folder of its checkpoint, for crosst5; the features are kept in it
    recipe: Path = Path("configs/small.yaml")  # for sizes, shares of the modes, rate and size of a batch
    core: int = 2  # or 1: keys and values without ReLU, dropout and norm
    free_slots: bool = False  # describe's prompts get zeros, up to 20 tokens that count
    modes: dict[str, float] | None = None  # shares in place of the recipe's
    dropout: float | None = None  # in place of the recipe's
    clip: float | None = None  # largest norm of the gradients, in place of the recipe's; 0: no limit
    seed: int = 1
    steps: int = 600
    minutes: float = 6.0  # of the processor, at most
    every: int = 7  # evaluate with every so many episodes of the test split
    output: Path = Path("pairs.json")
    speed: bool = False  # compare the time of steps with both cores, in turn
    table: Path | None = None  # folder of outputs, to show their last figures
    image: Path | None = None  # with table: file to draw learning curves into


class StoredFeatures(nn.Module):
    """A `VisualEncoder` that looks up what was seen of an episode, (episodes, 1 or L, dim)."""

    def __init__(self, features: Tensor, noise: float, names_objects: bool) -> None:
        super().__init__()
        self.names_objects = names_objects
        self._features, self._noise = features, noise

    def can_read(self, names: Sequence[str]) -> bool:
        """Any name."""
        return True

    def encode(self, batch: Mapping[str, Any], *_: Any) -> VisualInput:
        """Look episodes up; in training with the noise of `AutoencoderFeatures`."""
        seen = self._features[batch["episode_index"]]
        seen = seen + self._noise * self.training * torch.randn_like(seen)
        return VisualInput(seen, torch.ones(len(seen), dtype=torch.bool))

    encode_cached = encode

    def scenes(self, batch: Mapping[str, Any], *_: Any) -> list["StoredScene"]:
        """One for each sample."""
        return [StoredScene() for _ in batch["task"]]

    def features(self, batch: Mapping[str, Any], things: Sequence[Thing | None]) -> Tensor:
        """What was stored, whatever was found."""
        return self.encode(batch).features[:, :1]

    def find_moved(self, batch: Mapping[str, Any], labels: Sequence[str]) -> MovedObjects:
        """What the task names has moved: the simulator knows."""
        names = [parse_command(task).object if self.names_objects else "" for task in batch["task"]]
        return MovedObjects(*self.encode(batch), names)


class StoredScene:
    """A `Scene` in which what is meant is what was stored."""

    things: tuple[Thing, ...] = ()

    def find(self, search: Search) -> Found:
        """What is meant, called by no name."""
        return Found(Thing("it", torch.zeros(4)))


class Trial:
    """A policy, and the frames that it learns from, but for their images."""

    def __init__(self, config: PairsConfig) -> None:
        set_seed(config.seed)
        self.recipe = yaml.safe_load(config.recipe.read_text(encoding="utf-8"))
        seen = (
            {"detector": "ground_truth"} if config.policy == "owlxt5" else {"autoencoder": config.autoencoder}
        )
        options = self.recipe["policy"] | seen | {"language_model": "embedded", "device": "cpu"}
        given = {"mode_probabilities": config.modes, "dropout": config.dropout}
        options |= {name: value for name, value in given.items() if value is not None}
        meta = LeRobotDatasetMetadata("local/clant", root=config.dataset_root)
        self.policy: Any = make_policy(make_policy_config(config.policy, **options), ds_meta=meta)
        self.steps = self.policy.config.max_episode_steps
        low, high = (torch.as_tensor(meta.stats[ACTION][end]).float() for end in ("min", "max"))
        self.half, self.joint_range = (high - low) / 2, float(high.max() - low.min())
        rows = LeRobotDataset("local/clant", root=config.dataset_root).hf_dataset.data
        keys = (ACTION, OBS_STATE, OBS_OBJECTS, "episode_index", "frame_index", "task_index")
        column = {key: torch.from_numpy(np.stack(rows.column(key).to_numpy())) for key in keys}
        self.action, self.state = ((column[key] - low) / self.half - 1 for key in (ACTION, OBS_STATE))
        self.episode, self.first = column["episode_index"], (column["frame_index"] == 0).nonzero().flatten()
        self.tasks = [meta.tasks.index[each] for each in column["task_index"][self.first].tolist()]
        start, end = map(int, (meta.info.splits or {})["test"].split(":"))
        self.train, self.test = torch.arange(start), torch.arange(start, end, config.every)
        commands, objects = [*map(parse_command, self.tasks)], column[OBS_OBJECTS][self.first]
        found = GroundTruthDetector()({OBS_OBJECTS: objects}, [[each.object] for each in commands])
        # The three slots share the image's width.
        slots = (3 * found.centre[:, 0, 0]).int().tolist()
        self.movements = np.array([f"{each.verb} {slot}" for each, slot in zip(commands, slots, strict=True)])
        features, noise = 2 * found.centre - 1, 0.0
        if config.policy == "crosst5":
            features, noise = self._frame_features(Path(str(config.autoencoder))), FEATURE_NOISE
        del self.policy.visual
        self.policy.visual = StoredFeatures(features, noise, names_objects=config.policy == "owlxt5")

    def _frame_features(self, folder: Path) -> Tensor:
        """CrossT5's features of all frames, scaled as `AutoencoderFeatures` does."""
        file, autoencoder = folder / f"features_{len(self.tasks)}.safetensors", self.policy.visual.autoencoder
        if not file.exists():
            frames = self.policy.episodes.frames.read(self.policy.config.camera_key)
            held = (images[torch.arange(self.steps).clamp(max=len(images) - 1)] for _, images in frames)
            save_file({"features": torch.stack([autoencoder.encode_frames(images) for images in held])}, file)
        features = load_file(file)["features"]
        low, high = features[:, 0].amin(dim=0), features[:, 0].amax(dim=0)
        return (features - (high + low) / 2) / ((high - low) / 2).clamp(min=SMALLEST_RANGE)

    def batch(self, frames: Tensor) -> dict[str, Any]:
        """What `forward` reads of some frames."""
        episode = self.episode[frames]
        batch = {"index": frames, "episode_index": episode, "task": [self.tasks[each] for each in episode]}
        return batch | {ACTION: self.action[frames], OBS_STATE: self.state[self.first[episode]]}

    def learn(self, generator: torch.Generator) -> dict[str, float]:
        """Gradients of a batch that is drawn."""
        self.policy.train()
        size = (self.recipe["batch_size"],)
        frames = torch.randint(int(self.first[len(self.train)]), size, generator=generator)
        loss, terms = self.policy.forward(self.batch(frames))
        loss.backward()
        return terms

    @torch.no_grad()
    def evaluate(self) -> dict[str, float]:
        """The figures, in percent."""
        batch, texts = self.batch(self.first[self.test]), self.policy.episodes.texts
        true, length = self.policy.episodes.actions(batch, self.steps)
        known, _ = self.policy.episodes.actions(self.batch(self.first[self.train]), self.steps)
        step = torch.arange(1 - self.steps, self.steps)
        is_pad = (step < 0) | (step >= length[:, None])
        batch |= {ACTION: true[:, step.clamp(min=0)], "action_is_pad": is_pad}
        plans = {
            "execute": self.policy.predict_action_chunk(batch),
            "repeat": self.policy.repeat_action(batch),
        }
        figures = {}
        for name, plan in plans.items():
            degrees = ((each * self.half).double().numpy() for each in (plan, true))
            error = squared_errors(*degrees, length.numpy())
            figures[name] = float(nrmse(error, length.numpy() * len(self.half), self.joint_range))
        nearest = torch.cdist(plans["execute"].flatten(1), known.flatten(1)).argmin(dim=1)
        said = zip(self.policy.describe(batch), self.test.tolist(), strict=True)
        right = [is_accepted(text, [*map(spoken, texts[index].wordings)]) for text, index in said]
        bound = self.movements[nearest] == self.movements[self.test]
        return figures | {"nearest": 100 * float(np.mean(bound)), "describe": 100 * float(np.mean(right))}


@contextmanager
def _change(model: Any, core: int, free_slots: bool) -> Iterator[None]:
    """Compute another function with the same parameters."""
    transformer, language = model.core.crossmodal, model.language
    project, encode = transformer._project, language.encode

    def bare_keys(linear: nn.Linear, inputs: Tensor) -> Tensor:
        projected: Tensor = linear(inputs) if linear is transformer.keys else project(linear, inputs)
        return projected

    def padded(prompts: Sequence[str], device: torch.device) -> tuple[Tensor, Tensor]:
        encoding, mask = encode(prompts, device)
        if prompts[0].startswith("describe:"):
            encoding = nn.functional.pad(encoding, (0, 0, 0, SLOTS - encoding.shape[1]))
            mask = torch.ones(encoding.shape[:2], dtype=torch.bool, device=device)
        return encoding, mask

    transformer._project = bare_keys if core == 1 else project
    language.encode = padded if free_slots else encode
    yield
    transformer._project, language.encode = project, encode


def _train(config: PairsConfig, trial: Trial) -> None:
    """Train, evaluate now and then, and write the figures each time."""
    parameters, recipe = trial.policy.get_optim_params(), trial.recipe
    adam = {"lr": 1e-5, "betas": (0.9, 0.999), "grad_clip_norm": 10.0} | recipe.get("optimizer", {})
    clip = adam["grad_clip_norm"] if config.clip is None else config.clip
    optimizer = torch.optim.Adam(parameters, lr=adam["lr"], betas=adam["betas"])
    scheduler = torch.optim.lr_scheduler.ConstantLR(optimizer, factor=1.0)
    if "scheduler" in recipe:
        cosine = recipe["scheduler"] | {"num_decay_steps": config.steps}
        del cosine["type"]
        scheduler = CosineDecayWithWarmupSchedulerConfig(**cosine).build(optimizer, config.steps)
    generator, seconds = torch.Generator().manual_seed(config.seed), 0.0
    entries, terms = list[dict[str, float]](), list[dict[str, float]]()
    for step in range(1, config.steps + 1):
        began = time.process_time()
        terms.append(trial.learn(generator))
        terms[-1]["norm"] = float(nn.utils.clip_grad_norm_(parameters, clip or torch.inf))
        optimizer.step()
        optimizer.zero_grad()
        scheduler.step()
        seconds += time.process_time() - began
        late = seconds > 60 * config.minutes
        if late or step % (config.steps // EVALUATIONS) == 0:
            means = pd.DataFrame(terms).mean().to_dict() | {
                "largest_norm": max(each["norm"] for each in terms)
            }
            terms.clear()
            spent = {"step": step, "seconds": seconds, "step_seconds": seconds / step}
            entries.append(spent | means | trial.evaluate())
            text = json.dumps({"options": asdict(config), "entries": entries}, indent=1, default=str)
            config.output.parent.mkdir(parents=True, exist_ok=True)
            config.output.write_text(text, encoding="utf-8")
        if late:
            return


def _compare_speed(config: PairsConfig, trial: Trial) -> None:
    """Take steps on the same batches with both cores in turn, and print their medians."""
    seconds: dict[int, list[float]] = {1: [], 2: []}
    for step in range(2 * config.steps):
        # The first half lets T5 encode all prompts; the core that comes first takes turns.
        for core in sorted(seconds, reverse=step % 2 == 0):
            generator = torch.Generator().manual_seed(step % config.steps)
            trial.policy.training_seed.fill_(step % config.steps)
            began = time.process_time()
            with _change(trial.policy.model, core, config.free_slots):
                trial.learn(generator)
            seconds[core].append(time.process_time() - began)
    first, second = (float(np.median(each[config.steps :])) for each in seconds.values())
    print(f"A step of version 1: {first:.3f} s, of version 2: {second:.3f} s, ratio {second / first:.3f}")


def _show(folder: Path, image: Path | None) -> None:
    """Print the last figures of all files, and draw the curves of each policy and core."""
    found = {
        file.stem: json.loads(file.read_text(encoding="utf-8")) for file in sorted(folder.glob("*.json"))
    }
    last = {name: training["entries"][-1] for name, training in found.items()}
    print(pd.DataFrame(last).T[COLUMNS].to_string(float_format="{:.4g}".format))
    if image:
        import matplotlib.pyplot as plt

        figure, panels = plt.subplots(2, len(FIGURES), figsize=(11, 5), layout="constrained")
        for options, entries in (training.values() for training in found.values()):
            row = panels[["owlxt5", "crosst5"].index(options["policy"])]
            curves = pd.DataFrame(entries).set_index("step")[FIGURES]
            colour = f"C{int(options['core']) - 1}"
            curves.plot(ax=row, subplots=True, color=colour, legend=False)
            for panel, name in zip(row, FIGURES, strict=True):
                panel.set(title=f"{options['policy']}: {name}, %", xlabel="steps")
        for panel in panels.flat:
            panel.set_ylim(bottom=0)
        figure.suptitle("blue: version 1 of the core, orange: version 2; a line for each seed")
        figure.savefig(image, dpi=80)


@command("pairs")
def main(config: PairsConfig) -> None:
    """Train one policy, or compare or show."""
    if config.table:
        return _show(config.table, config.image)
    trial = Trial(config)
    if config.speed:
        return _compare_speed(config, trial)
    with _change(trial.policy.model, config.core, config.free_slots):
        _train(config, trial)


if __name__ == "__main__":
    main()
