# SPDX-License-Identifier: Apache-2.0
"""README's Python example runs as it stands, and the options that the documents name exist."""

import re
import shlex
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest
import yaml
from lerobot.configs.eval import EvalPipelineConfig
from lerobot.configs.train import TrainPipelineConfig
from lerobot.datasets import LeRobotDataset
from lerobot.optim import CosineDecayWithWarmupSchedulerConfig
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.factory import make_pre_post_processors
from lerobot.rollout import EpisodicStrategyConfig, RolloutConfig
from lerobot.scripts.lerobot_replay import ReplayConfig
from PIL import Image

from clant_claeo.cli import DatasetConfig
from lerobot_owlxt5.configuration_crosst5 import CrossT5Config
from lerobot_owlxt5.configuration_early_fusion import EarlyFusionConfig
from lerobot_owlxt5.configuration_owlxt5 import OWLxT5Config
from lerobot_owlxt5.evaluation.cli import EvaluateConfig
from nico_tabletop.config_nico_sim import NicoSimConfig
from nico_tabletop.configuration import ClaeoEnvConfig
from owlxt5_backbones.train import BackbonesConfig
from policy_helpers import make_policy

ROOT = Path(__file__).parent.parent
README = ROOT / "README.md"
COMMANDS = {
    "owlxt5-dataset": DatasetConfig,
    "owlxt5-backbones": BackbonesConfig,
    "owlxt5-evaluate": EvaluateConfig,
    "lerobot-train": TrainPipelineConfig,
    "lerobot-eval": EvalPipelineConfig,
    "lerobot-rollout": RolloutConfig,
    "lerobot-replay": ReplayConfig,
}
CHOICES = {
    "policy": (OWLxT5Config, CrossT5Config, EarlyFusionConfig, ACTConfig),
    "env": (ClaeoEnvConfig,),
    "robot": (NicoSimConfig,),
    "strategy": (EpisodicStrategyConfig,),
    "scheduler": (CosineDecayWithWarmupSchedulerConfig,),
}
CHECKPOINT = "outputs/demo/train/checkpoints/last/pretrained_model"


@pytest.mark.slow
def test_the_readmes_example_runs(
    dataset: LeRobotDataset, t5: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    policy = make_policy(t5, detector="embedded")
    policy.save_pretrained(tmp_path)
    for processor in make_pre_post_processors(policy.config, dataset_stats=dataset.meta.stats):
        processor.save_pretrained(tmp_path)
    [code] = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert CHECKPOINT in code
    capsys.readouterr()
    names: dict[str, Any] = {}
    exec(code.replace(CHECKPOINT, str(tmp_path)), names)
    answer, description, outcome = capsys.readouterr().out.splitlines()[-3:]
    # An untrained policy: what it has done is for the detector to see.
    assert names["name"] in answer
    assert answer.startswith(("I pushed the", "I tried to push the"))
    assert description
    assert outcome in ("perfect", "successful", "failure")


def documented_commands() -> list[tuple[str, str, tuple[str, ...]]]:
    """Document, command and the names of its options, of each command in a block of shell code."""
    found = []
    for path in (README, *sorted((ROOT / "docs").glob("*.md"))):
        for block in re.findall(r"```bash\n(.*?)```", path.read_text(encoding="utf-8"), flags=re.DOTALL):
            for line in block.replace("\\\n", " ").splitlines():
                words = shlex.split(re.sub(r"\$\(.*?\)|\$\w+", "_", line), comments=True)
                for word in words:
                    if word in COMMANDS:
                        names = re.findall(r"(?:^|\s)--([\w.]+)", " ".join(words[words.index(word) :]))
                        found.append((path.name, word, tuple(names)))
    return found


def has_option(config: type, name: str) -> bool:
    """Whether a configuration has the option `name`, whose parts stand between dots."""
    first, _, rest = name.partition(".")
    if first not in {each.name for each in fields(config)}:
        return False
    kinds = [kind for kind in (get_type_hints(config)[first], *get_args(get_type_hints(config)[first]))]
    return not rest or any(has_option(kind, rest) for kind in kinds if is_dataclass(kind))


@pytest.mark.parametrize(("document", "command", "options"), sorted(set(documented_commands())))
def test_documented_options_exist(document: str, command: str, options: tuple[str, ...]) -> None:
    for option in options:
        first, _, rest = option.partition(".")
        if first in CHOICES:
            known = rest in ("path", "type") or any(has_option(each, rest) for each in CHOICES[first])
        else:
            known = option == "config_path" or has_option(COMMANDS[command], option)
        assert known, f"{document}: {command} --{option}"


def test_the_papers_recipe_is_the_papers() -> None:
    recipe = yaml.safe_load((ROOT / "configs" / "paper.yaml").read_text(encoding="utf-8"))
    assert recipe["steps"] * recipe["batch_size"] == 10_000 * 1080
    assert set(recipe) <= {each.name for each in fields(TrainPipelineConfig)}
    config = OWLxT5Config(**recipe["policy"], device="cpu")
    assert config.get_optimizer_preset().lr == 1e-5
    assert config.get_scheduler_preset() is None
    assert (config.language_model, config.detector) == ("google-t5/t5-small", "google/owlv2-base-patch16")


def test_the_film_is_small_and_in_true_colours() -> None:
    film = ROOT / "docs" / "images" / "film.webp"
    assert film.stat().st_size < 3e6
    with Image.open(film) as image:
        assert image.n_frames > 10
        colours = image.convert("RGB").getcolors(maxcolors=1 << 24)
    assert len(colours) > 256  # more than a palette holds
