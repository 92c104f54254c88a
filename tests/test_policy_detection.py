# SPDX-License-Identifier: Apache-2.0
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from lerobot.datasets import LeRobotDataset

from lerobot_owlxt5.backbones.detections import Candidates, Detections
from lerobot_owlxt5.backbones.ground_truth import GroundTruthDetector
from lerobot_owlxt5.backbones.owl import to_image_coordinates
from lerobot_owlxt5.backbones.zero_shot import DARK, ZeroShotDetector, only_inside
from lerobot_owlxt5.data.episode_store import EpisodeStore
from lerobot_owlxt5.data.windows import observation_at
from policy_helpers import EYES, make_grounding_dino, make_owlv2, make_owlvit, make_policy, observe


@given(st.integers(1, 2000), st.integers(1, 2000), st.floats(0, 1), st.floats(0, 1))
def test_image_coordinates_undo_the_padding(height: int, width: int, x: float, y: float) -> None:
    side = max(height, width)
    in_square = torch.tensor([x * width / side, y * height / side], dtype=torch.float64)
    back = to_image_coordinates(in_square, height, width)
    assert torch.allclose(back, torch.tensor([x, y], dtype=torch.float64))


@pytest.fixture(scope="module")
def owlv2(tmp_path_factory: pytest.TempPathFactory) -> ZeroShotDetector:
    return ZeroShotDetector(str(make_owlv2(tmp_path_factory.mktemp("owlv2"))), None, 0.1, EYES)


class BrightestPatch(torch.nn.Module):
    """Stands in for OWLv2's network: its boxes are the patches, and a bright patch has a high score."""

    def forward(self, pixel_values: torch.Tensor, input_ids: torch.Tensor, **_: Any) -> SimpleNamespace:
        patches = 16
        brightness = torch.nn.functional.adaptive_avg_pool2d(pixel_values.mean(1), patches).flatten(1)
        middle = (torch.arange(patches) + 0.5) / patches
        centre = torch.stack(torch.meshgrid(middle, middle, indexing="xy"), -1).view(1, -1, 2)
        boxes = torch.cat([centre, torch.full_like(centre, 1 / patches)], -1).expand(
            len(pixel_values), -1, -1
        )
        queries = len(input_ids) // len(pixel_values)
        logits = brightness[..., None].expand(-1, -1, queries) * 4 - 4
        return SimpleNamespace(pred_boxes=boxes, logits=logits, class_embeds=None)


def look_at_bright_patches(detector: ZeroShotDetector, monkeypatch: pytest.MonkeyPatch) -> None:
    """Put `BrightestPatch` in the place of the detector's network; processor and box mathematics stay."""
    monkeypatch.setattr(detector.candidates, "model", BrightestPatch())


@pytest.mark.parametrize("size", [(64, 64), (64, 128), (128, 64)])
def test_the_real_processor_and_the_box_maths_agree_on_images_of_any_shape(
    owlv2: ZeroShotDetector, size: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    height, width = size
    look_at_bright_patches(owlv2, monkeypatch)
    images = torch.zeros(1, 3, height, width)
    top, left = height // 2, 3 * width // 4
    images[:, :, top : top + 8, left : left + 8] = 1.0
    found = owlv2({EYES: images}, [["ball", "mug"]])
    expected = torch.tensor([(left + 4) / width, (top + 4) / height])
    assert torch.allclose(found.centre, expected.expand(1, 2, 2), atol=0.07)
    assert (found.score > 0.1).all()


def test_a_box_half_outside_the_image_is_no_thing() -> None:
    boxes = torch.tensor([[[0.82, 0.42, 0.99, 0.63], [0.91, 0.42, 1.09, 0.63], [-0.02, 0.4, 0.2, 0.6]]])
    scores = torch.full((1, 3, 1), 0.9)
    assert only_inside(Candidates(boxes, scores)).score.flatten().tolist() == pytest.approx([0.9, 0.0, 0.9])


class BrightestPixel(torch.nn.Module):
    """Stands in for Grounding DINO's network: one box about the brightest pixel, scored by the token."""

    def forward(self, pixel_values: torch.Tensor, input_ids: torch.Tensor, **_: Any) -> SimpleNamespace:
        height, width = pixel_values.shape[-2:]
        row, column = divmod(int(pixel_values[0].mean(0).argmax()), width)
        box = torch.tensor([[[(column + 0.5) / width, (row + 0.5) / height, 0.1, 0.1]]])
        return SimpleNamespace(pred_boxes=box, logits=(input_ids.float() - 8)[:, None])


@pytest.mark.parametrize(
    ("make", "network"),
    [(make_owlv2, BrightestPatch), (make_owlvit, BrightestPatch), (make_grounding_dino, BrightestPixel)],
)
def test_a_detector_of_each_kind_finds_its_place_on_a_wide_image(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, make: Any, network: type[torch.nn.Module]
) -> None:
    detector = ZeroShotDetector(str(make(tmp_path)), None, None, EYES)
    images = torch.zeros(1, 3, 64, 128)
    images[:, :, 32:40, 96:104] = 1.0
    real = detector({EYES: images}, [["ball", "wine bottle"]])
    assert real.box.shape == (1, 2, 4) and ((real.score >= 0) & (real.score <= 1)).all()
    monkeypatch.setattr(detector.candidates, "model", network())
    found = detector({EYES: images}, [["ball", "wine bottle"]])
    assert torch.allclose(found.centre, torch.tensor([100 / 128, 36 / 64]).expand(1, 2, 2), atol=0.07)
    if network is BrightestPixel:
        # "ball" is token 5, "wine bottle" 9 and 10: the best token of a name counts, the full stops do not.
        assert torch.allclose(found.score, torch.tensor([[-3.0, 2.0]]).sigmoid())


def test_a_model_of_another_kind_is_no_detector(t5: Path) -> None:
    with pytest.raises(
        ValueError, match=r"--policy.detector=\S+ is a t5; give one of owlv2, owlvit, grounding-dino"
    ):
        make_policy(t5, detector=str(t5))


def test_owlv2_can_look_at_one_place_alone(owlv2: ZeroShotDetector, monkeypatch: pytest.MonkeyPatch) -> None:
    look_at_bright_patches(owlv2, monkeypatch)
    images = torch.full((1, 3, 64, 64), DARK)  # a darker one would be brightened
    images[:, :, 8:12, 8:12] = 1.0
    images[:, :, 40:44, 40:44] = 0.7
    dimmer, dark = ((40 + 2) / 64, (40 + 2) / 64), ((24 + 2) / 64, (40 + 2) / 64)
    anywhere = owlv2({EYES: images}, [["ball", "mug"]])
    proposed = owlv2.propose({EYES: images}, [["ball", "mug"]])
    near = proposed.best(proposed.at(torch.tensor([[dimmer, dark]])))
    assert torch.allclose(near.centre, torch.tensor([[dimmer, dark]]))
    assert near.score[0, 1] < near.score[0, 0] < anywhere.score[0, 0]


def test_centre_of_a_box_and_foot_without_perspective() -> None:
    found = Detections(torch.tensor([[[0.2, 0.3, 0.4, 0.8]]]), torch.ones(1, 1))
    assert torch.allclose(found.centre, torch.tensor([[[0.3, 0.55]]]))
    assert torch.allclose(found.foot(None), torch.tensor([[[0.3, 0.8]]]))


@given(
    tilt=st.floats(30, 75), field=st.floats(30, 80), ahead=st.floats(0.3, 0.9), aside=st.floats(-0.3, 0.3),
    height=st.floats(0.01, 0.3),
)  # fmt: skip
def test_the_foot_of_a_pole_is_where_it_stands(
    tilt: float, field: float, ahead: float, aside: float, height: float
) -> None:
    """The pole stands on a plane one metre below a camera that looks down by `tilt` degrees."""
    sine, cosine = math.sin(math.radians(tilt)), math.cos(math.radians(tilt))
    half = math.tan(math.radians(field) / 2)

    def project(above: float) -> tuple[float, float]:
        below = 1 - above
        depth = ahead * cosine + below * sine
        return 0.5 + aside / depth / half / 2, 0.5 + (below * cosine - ahead * sine) / depth / half / 2

    base, top = project(0), project(height)
    box = [min(base[0], top[0]), top[1], max(base[0], top[0]), base[1]]
    found = Detections(torch.tensor([[box]], dtype=torch.float64), torch.ones(1, 1))
    foot = found.foot(nadir=0.5 + cosine / sine / half / 2)
    assert torch.allclose(foot, torch.tensor([[base]], dtype=torch.float64), atol=1e-9)


def test_owlv2_runs_in_batches(owlv2: ZeroShotDetector) -> None:
    batch = observe(["push red"] * 10)
    names = [["red"]] * 10
    one = owlv2({EYES: batch[EYES][3:4]}, names[:1])
    every = owlv2(batch, names)
    assert every.centre.shape == (10, 1, 2)
    assert torch.allclose(every.score[3], one.score[0], atol=1e-5)
    as_bytes = owlv2({EYES: (batch[EYES] * 255).round().byte()}, names)
    assert torch.allclose(as_bytes.score, every.score, atol=1e-2)


def test_ground_truth_names() -> None:
    objects = [["red", "mustard bottle", "empty wine bottle"]]
    batch = observe(["-"], objects)
    asked = ["red", "red cube", "mustard bottle", "wine bottle", "bottle", "ball", ""]
    found = GroundTruthDetector()(batch, [asked])
    assert found.score.tolist() == [[1, 1, 1, 1, 1, 0, 0]]
    # Two bottles fit: who asks for one has to choose.
    things = GroundTruthDetector().propose(batch, [asked]).things(0.5)
    assert things.score[:, 4].tolist() == [0, 1, 1]
    assert torch.allclose(found.centre[0, :4, 0], torch.tensor([0.2, 0.2, 0.5, 0.8]))


def test_ground_truth_does_not_see_what_is_out_of_view() -> None:
    batch = observe(["-"])
    batch["observation.objects"][0, :4] = -1
    assert GroundTruthDetector()(batch, [["red", "ball"]]).score.tolist() == [[0, 1]]


def test_ground_truth_looks_at_the_step_it_is_told_to() -> None:
    before, after = (
        observe(["-"], [names])["observation.objects"] for names in (["red", "", ""], ["", "", "red"])
    )
    batch = {"observation.objects": torch.stack([before, after], dim=1)}
    look = GroundTruthDetector()
    first, last = (observation_at(batch, step) for step in (0, -1))
    places = [look(observation, [["red"]]).centre for observation in (first, last)]
    assert [place[0, 0, 0].item() for place in places] == pytest.approx([0.2, 0.8])
    proposed = look.propose(last, [["red"]])
    assert [proposed.best(proposed.at(place)).score.item() for place in places] == [0, 1]


def test_ground_truth_needs_the_simulator() -> None:
    with pytest.raises(ValueError, match=r"observation.objects.*--policy.detector"):
        GroundTruthDetector()({}, [["red"]])


def test_each_episode_is_looked_at_once(
    dataset: LeRobotDataset, t5: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    visual, store = make_policy(t5).visual, EpisodeStore(dataset.meta)
    looked_at: list[int] = []
    look = visual.detector

    def count(observation: dict[str, Any], names: Any) -> Detections:
        looked_at.append(len(names))
        return look(observation, names)

    monkeypatch.setattr(visual, "detector", count)
    monkeypatch.setattr(count, "threshold", look.threshold, raising=False)
    batch = observe(["-"] * 3, [["red", "blue", ""], ["", "blue", "red"], ["red", "blue", ""]])
    batch |= {"action": torch.zeros(3, 10), "episode_index": torch.tensor([4, 7, 4])}
    names = ["red", "blue", "red"]
    once = visual.encode(batch, names)
    again = [visual.encode_cached(batch, names, store) for _ in range(2)]
    assert all(torch.allclose(each.features, once.features) for each in again)
    assert looked_at == [3, 2]


def test_an_episode_whose_image_changes_is_looked_at_each_time(
    dataset: LeRobotDataset, t5: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """LeRobot transforms images anew whenever it delivers them: where an object was is not where it is."""
    visual = make_policy(t5, detector=str(make_owlv2(tmp_path)), score_threshold=0.0).visual
    store, names = EpisodeStore(dataset.meta), ["red", "blue", "red"]
    batch = observe(["-"] * 3) | {"action": torch.zeros(3, 10), "episode_index": torch.tensor([4, 7, 5])}
    for _ in range(2):
        visual.encode_cached(batch, names, store)
    assert not caplog.text
    for _ in range(2):
        batch = batch | {EYES: batch[EYES].roll(8, dims=-1)}
        seen, expected = visual.encode_cached(batch, names, store), visual.encode(batch, names)
        assert torch.equal(seen.features, expected.features)
    assert caplog.text.count("--dataset.image_transforms") == 1
