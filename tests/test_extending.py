# SPDX-License-Identifier: Apache-2.0
"""What docs/extending.md promises: a policy and a detector from outside the package."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import pytest
import torch
from lerobot.configs import PreTrainedConfig
from lerobot.datasets import LeRobotDataset, LeRobotDatasetMetadata
from lerobot.datasets.factory import resolve_delta_timestamps
from lerobot.policies.factory import make_policy, make_pre_post_processors
from lerobot.utils.collate import lerobot_collate_fn
from torch import Tensor

from lerobot_owlxt5.backbones.detections import Candidates
from lerobot_owlxt5.backbones.zero_shot import KINDS, Kind, ZeroShotDetector
from lerobot_owlxt5.configuration_crossmodal import CrossmodalConfig
from lerobot_owlxt5.configuration_owlxt5 import OWLxT5Config
from lerobot_owlxt5.data.episode_store import EpisodeStore
from lerobot_owlxt5.data.windows import observation_at
from lerobot_owlxt5.modeling_crossmodal import CrossmodalPolicy
from lerobot_owlxt5.processor_owlxt5 import make_owlxt5_pre_post_processors
from lerobot_owlxt5.visual_encoder import MovedObjects, VisualInput
from policy_helpers import ENDS, EYES, HORIZON, load_batch, make_owlv2, small_options


@PreTrainedConfig.register_subclass("mean_colour")
@dataclass
class MeanColourConfig(CrossmodalConfig):
    """A policy that knows the mean colour of an image."""

    dim_visual: ClassVar[int] = 3


class MeanColour:
    """Its visual encoder; see `lerobot_owlxt5.visual_encoder.VisualEncoder`."""

    names_objects = False

    def encode(self, batch: Mapping[str, Any], names: Sequence[str]) -> VisualInput:
        colour = observation_at(batch, 0)[EYES].mean(dim=(-1, -2))
        return VisualInput(colour[:, None], torch.ones(len(colour), dtype=torch.bool))

    def encode_cached(
        self, batch: Mapping[str, Any], names: Sequence[str], episodes: EpisodeStore
    ) -> VisualInput:
        return self.encode(batch, names)

    def find_moved(self, batch: Mapping[str, Any], labels: Sequence[str]) -> MovedObjects:
        features, seen = self.encode(batch, labels)
        return MovedObjects(features, seen, [""] * len(features))


class MeanColourPolicy(CrossmodalPolicy):
    config_class = MeanColourConfig
    name = "mean_colour"

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.visual = MeanColour()


@pytest.mark.slow
def test_a_policy_from_outside_trains_acts_and_speaks(
    dataset: LeRobotDataset, t5: Path, tmp_path: Path
) -> None:
    from lerobot.policies.factory import dataset_to_policy_features

    config = MeanColourConfig(**small_options(t5))
    features = dataset_to_policy_features(dataset.meta.features)
    config.input_features = {key: each for key, each in features.items() if key.startswith("observation")}
    config.output_features = {"action": features["action"]}
    torch.manual_seed(0)
    policy = MeanColourPolicy(config, dataset_meta=dataset.meta)
    preprocess, postprocess = make_owlxt5_pre_post_processors(config, dataset.meta.stats)
    optimizer = torch.optim.Adam(policy.get_optim_params(), 1e-2)
    batch = load_batch(dataset.root, [0, 7, 20, 26], preprocess)
    losses = []
    for _ in range(20):
        loss, _ = policy.train().forward(batch)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert sum(losses[-5:]) < sum(losses[:5])

    policy.save_pretrained(tmp_path)
    loaded = MeanColourPolicy.from_pretrained(tmp_path)
    seen = {key: value for key, value in batch.items() if key.startswith("observation") or key == "task"}
    plan = postprocess(loaded.predict_action_chunk(seen))
    assert plan.shape == (4, HORIZON, 10)
    assert loaded.responses[0].startswith("I will ")
    finished = load_batch(dataset.root, [0, 20], preprocess, finished=ENDS)
    assert len(loaded.describe(finished)) == 2


@pytest.mark.slow
def test_the_documented_recording_of_another_robot_trains(t5: Path, tmp_path: Path) -> None:
    text = (Path(__file__).parents[1] / "docs" / "extending.md").read_text(encoding="utf-8")
    [code] = [each for each in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if ".create(" in each]
    exec(code.replace("outputs/mine", str(tmp_path / "mine")), {})
    meta = LeRobotDatasetMetadata("me/mine", root=tmp_path / "mine")
    assert (meta.total_episodes, meta.total_frames) == (2, 40)
    config = OWLxT5Config(
        **small_options(t5) | {"max_episode_steps": 20},
        detector=str(make_owlv2(tmp_path / "owlv2")),
        camera="observation.images.front",
    )
    policy = make_policy(config, ds_meta=meta)
    preprocess, _ = make_pre_post_processors(config, dataset_stats=meta.stats)
    windows = resolve_delta_timestamps(config, meta)
    recorded = LeRobotDataset("me/mine", root=meta.root, delta_timestamps=windows, video_backend="pyav")
    loss, _ = policy.train().forward(preprocess(lerobot_collate_fn([recorded[0], recorded[25]])))
    loss.backward()
    assert torch.isfinite(loss)


class WholeImage:
    """A detector that finds everything everywhere."""

    usual_threshold = 0.5

    def __init__(self, model: Any, processor: Any) -> None:
        self.model = model

    def can_read(self, names: Sequence[str]) -> bool:
        return True

    def __call__(self, images: Tensor, names: Sequence[Sequence[str]]) -> Candidates:
        box = torch.tensor([0.0, 0.0, 1.0, 1.0]).expand(len(images), 1, 4)
        return Candidates(box, torch.ones(len(images), 1, len(names[0])))


def test_a_detector_from_outside_is_found_by_its_model_type(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(KINDS, "owlv2", Kind(KINDS["owlv2"].processor, WholeImage))
    detector = ZeroShotDetector(str(make_owlv2(tmp_path)), None, None, EYES)
    found = detector({EYES: torch.rand(2, 3, 24, 48)}, [["ball"], ["mug"]])
    assert detector.threshold == 0.5
    assert torch.equal(found.centre, torch.full((2, 1, 2), 0.5))
