# SPDX-License-Identifier: Apache-2.0
"""The scenes and queries that the small detector is trained on, and that it learns."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from lerobot_owlxt5.backbones.pretrained import EMBEDDED
from lerobot_owlxt5.backbones.zero_shot import ZeroShotDetector
from nico_tabletop.objects import CUBE_HALF_WIDTH, read_objects, visible_surface
from nico_tabletop.placement import SLOT_POSES
from nico_tabletop.robot import EYES
from nico_tabletop.scene import build_model
from nico_tabletop.simulation import TabletopSimulation
from nico_tabletop.variation import Conditions
from owlxt5_backbones import card, queries, train
from owlxt5_backbones.catalogue import CATEGORIES, COLOURS, HELD_OUT, draw_instance
from owlxt5_backbones.detector import DetectorSizes, make_detector_model, predict_patches
from owlxt5_backbones.detector_batches import Collator
from owlxt5_backbones.detector_training import detection_loss
from owlxt5_backbones.evaluate_detector import evaluate_detector
from owlxt5_backbones.queries import NAMES, Query, draw_queries
from owlxt5_backbones.scenes import HEIGHT, WIDTH, RandomScenes
from owlxt5_backbones.train import BackbonesConfig, train_detector

pytestmark = pytest.mark.slow  # trains

TINY = DetectorSizes(image_size=64, width=32, layers=1, heads=2, text_width=32, text_layers=1, vocabulary=600)


@pytest.mark.parametrize("category", CATEGORIES)
def test_instances_stand_on_the_table_and_are_of_its_size(category: str) -> None:
    rng = np.random.default_rng(0)
    items = tuple(draw_instance(rng, category, str(k)).item for k in range(12))
    model = build_model(items)
    for item in items:
        points = visible_surface(model, item.name) + np.array([0, 0, CUBE_HALF_WIDTH])
        low, high = points.min(axis=0), points.max(axis=0)
        assert -0.004 < low[2] < 0.005
        assert high[2] < 0.21
        assert np.abs([low[:2], high[:2]]).max() < 0.075
        assert (high - low).max() > 0.02


def test_held_out_categories_are_not_drawn() -> None:
    everything = {name for names, _ in CATEGORIES.values() for name in names}
    held_out = [item for item in read_objects("household") if item.name in HELD_OUT]
    assert len(held_out) == len(HELD_OUT)
    assert not everything & {name for item in held_out for name in (item.name, *item.synonyms)}


def test_the_detector_knows_the_words_of_both_papers() -> None:
    known = {name for names, _ in CATEGORIES.values() for name in names}
    colours = {name for names, _ in COLOURS.values() for name in names}
    for item in read_objects("claeo"):
        assert item.name.removeprefix("white ") in known
        assert {*item.synonyms} <= known
    for item in read_objects("clant"):
        assert {name.replace("-", " ") for name in (item.name, *item.synonyms)} <= colours


@pytest.fixture(scope="module")
def images() -> list[dict[str, Any]]:
    world = RandomScenes(np.random.default_rng(0))
    found = [image for image, _ in zip(world.images(), range(12), strict=False)]
    world.close()
    return found


def test_boxes_hold_what_stands_out_from_the_table(images: list[dict[str, Any]]) -> None:
    assert sum(len(image["objects"]) for image in images) > 20
    for image in images:
        assert image["image"].shape == (HEIGHT, WIDTH, 3)
        for item in image["objects"]:
            x0, y0, x1, y1 = item["box"]
            assert 0 <= x0 < x1 <= 1
            assert 0 <= y0 < y1 <= 1


def test_the_same_seed_gives_the_same_images(images: list[dict[str, Any]]) -> None:
    world = RandomScenes(np.random.default_rng(0))
    again = next(world.images())
    world.close()
    assert (again["image"] == images[0]["image"]).all()
    assert again["objects"] == images[0]["objects"]


SCENE = [
    {"names": ["cube", "block"], "colours": ["red", "scarlet"], "box": [0.1, 0.4, 0.2, 0.5]},
    {"names": ["cube", "block"], "colours": ["blue", "azure"], "box": [0.6, 0.4, 0.7, 0.5]},
    {"names": ["wine bottle", "bottle"], "colours": [], "box": [0.4, 0.3, 0.5, 0.6]},
]


@pytest.mark.parametrize(
    ("query", "meant"),
    [
        (Query("cube"), (0, 1)),
        (Query("block", "scarlet"), (0,)),
        (Query("cube", "green"), ()),
        (Query("cube", side="right"), (1,)),
        (Query("cube", side="left"), (0,)),
        (Query("bottle"), (2,)),
        (Query("mug"), ()),
        (Query("mug", "red"), ()),
        (Query("mug", side="left"), ()),
        # Nobody said which colour the bottle has, and there is only one.
        (Query("bottle", "green"), None),
        (Query("bottle", side="left"), None),
    ],
)
def test_queries_mean_what_they_say(query: Query, meant: tuple[int, ...] | None) -> None:
    assert query.meant(SCENE) == meant


def test_queries_are_all_names_and_others_that_fit_the_images() -> None:
    drawn = draw_queries([SCENE, []], np.random.default_rng(0), 60)
    assert len({*drawn}) == len(drawn) == len(NAMES) + 60
    assert {Query(name) for name in NAMES} <= {*drawn}
    others = drawn[len(NAMES) :]
    assert sum(bool(query.meant(SCENE)) for query in others) > 5
    assert sum(query.meant(SCENE) == () for query in others) > 20
    assert all(query.meant([]) == () for query in drawn)
    assert len(draw_queries([[]], np.random.default_rng(0), 60)) == len(drawn)


def test_a_perfect_detection_costs_less_than_a_shifted_or_a_wrong_one() -> None:
    boxes = torch.tensor([[[0.3, 0.3, 0.2, 0.2], [0.7, 0.6, 0.1, 0.2], [0.0, 0.0, 0.0, 0.0]]])
    positive = torch.tensor([[[True, False], [False, False], [False, False]]])
    known = torch.ones(1, 2, dtype=torch.bool)
    logits = torch.where(positive, 12.0, -12.0)
    perfect = detection_loss(logits, boxes, positive, boxes, known)
    assert perfect < 0.01
    assert detection_loss(logits, boxes + 0.05, positive, boxes, known) > perfect + 0.1
    assert detection_loss(logits.flip(-1), boxes, positive, boxes, known) > perfect + 1
    assert detection_loss(logits.flip(-1), boxes, positive, boxes, ~known) < perfect + 0.01
    nothing = detection_loss(logits, boxes, positive & False, torch.zeros_like(boxes), known)
    assert torch.isfinite(nothing)


def test_flipped_images_keep_left_and_right_true(images: list[dict[str, Any]]) -> None:
    _, processor = make_detector_model(TINY, 0)
    torch.manual_seed(0)
    batch = Collator(processor, 4)(images)
    assert batch["pixel_values"].shape == (len(images), 3, 64, 64)
    assert batch["patches"].sort(dim=1).values.tolist() == [[*range(16)]] * len(images)
    assert batch["positive"].shape == (len(images), 16, len(batch["input_ids"]))
    assert batch["positive"].any(dim=1).any(dim=1).sum() > len(images) / 2
    assert len(batch["input_ids"]) == batch["known"].shape[1]
    assert 0.5 < batch["known"].float().mean() < 1
    # An image is padded at the bottom: nothing is below three quarters of the square.
    assert (batch["boxes"][..., 1] < HEIGHT / WIDTH).all()
    collate = Collator(processor, 4)
    rightmost = {float(collate(images[:1])["boxes"][0, :, 0].max()) for _ in range(9)}
    assert len(rightmost) == 2  # as it is and flipped


@pytest.mark.parametrize("count", [0, 1])
def test_patches_with_an_object_are_looked_at_and_find_it(images: list[dict[str, Any]], count: int) -> None:
    _, processor = make_detector_model(TINY, 0)
    item = {"names": ["mug"], "colours": ["red"], "box": [0.5, 0.4, 0.7, 0.8]}
    collate = Collator(processor, 16, 64)
    batches = [collate([{**images[0], "objects": [item] * count}]) for _ in range(12)]
    assert {batch["patches"].shape[1] for batch in batches} <= {64, 256}
    for batch in batches:
        patches, positive, boxes = (batch[key][0] for key in ("patches", "positive", "boxes"))
        x, y = (patches % 16 + 0.5) / 16, (patches // 16 + 0.5) / 16
        found = boxes[:, 2] > 0
        assert torch.equal(found, positive[:, NAMES.index("mug")])
        assert not positive[:, NAMES.index("banana")].any()
        if count:
            centre = boxes[found][:, :2].mean(dim=0)
            assert min(abs(centre[0] - 0.6), abs(centre[0] - 0.4)) < 1e-6
            assert abs(centre[1] - 0.6 * HEIGHT / WIDTH) < 1e-6
            # 0.16 by 0.24 of the square, in patches of a sixteenth.
            assert found.sum() in (6, 8, 9, 12)
            assert ((x - centre[0]).abs() <= 0.081)[found].all()
            assert ((y - centre[1]).abs() <= 0.121)[found].all()
        else:
            assert not found.any()


def test_prepared_images_are_what_the_processor_makes(images: list[dict[str, Any]]) -> None:
    _, processor = make_detector_model(DetectorSizes(), 0)
    image = {**images[0], "image": np.full((240, 320, 3), 128, dtype=np.uint8)}
    image["image"][100:140, 60:120] = 30
    collate = Collator(processor, 16)
    collate.relight = torch.nn.Identity()
    mine = collate([image])["pixel_values"][0]
    theirs = processor(images=image["image"], return_tensors="pt")["pixel_values"][0]
    nearest = min((mine - each).abs().mean() for each in (theirs, theirs.flip(-1)))
    assert nearest < 0.01


def test_asking_all_images_the_same_is_what_the_network_itself_computes(
    images: list[dict[str, Any]],
) -> None:
    model, processor = make_detector_model(TINY, 0)
    model.eval()
    batch = Collator(processor, 4)(images[:2])
    asked = {key: batch[key] for key in ("pixel_values", "input_ids", "attention_mask")}
    with torch.no_grad():
        logits, boxes = predict_patches(model, **asked, patches=batch["patches"])
        repeated = {key: asked[key].repeat(2, 1) for key in ("input_ids", "attention_mask")}
        whole = model(pixel_values=asked["pixel_values"], **repeated)
    for sample, patches in enumerate(batch["patches"]):
        assert torch.allclose(logits[sample], whole.logits[sample, patches], atol=1e-4)
        assert torch.allclose(boxes[sample], whole.pred_boxes[sample, patches], atol=1e-5)


def test_the_tokenizer_spells_any_name() -> None:
    _, processor = make_detector_model(TINY, 0)
    texts = ["a photo of a red cube", "a photo of a xylophone", "a photo of a Gießkanne"]
    tokens = processor.tokenizer(texts)["input_ids"]
    unknown = processor.tokenizer.unk_token_id
    assert all(processor.tokenizer.decode(each, skip_special_tokens=True).strip() for each in tokens)
    assert all(unknown not in each[1:-1] for each in tokens)
    assert queries.all_texts()


def test_the_embedded_detector_finds_what_is_there_and_nothing_else() -> None:
    metrics = evaluate_detector("embedded", "claeo", "free", 6)
    assert metrics.recall > 0.9
    assert metrics.true_negative_rate > 0.9


def test_a_miniature_detector_learns_is_evaluated_and_gets_a_card(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(train, "_VALIDATION_IMAGES", 48)
    config = BackbonesConfig("detector", tmp_path, steps=30, batch_size=8, images=48, learning_rate=2e-3)
    model, losses = train_detector(config, TINY)
    assert np.mean(losses[-5:]) < 0.8 * np.mean(losses[:5])
    assert 0 < model.config.score_threshold < 1
    metrics = evaluate_detector(str(config.model_dir), "claeo", "slots", 2)
    assert metrics.present == 12  # three of six objects, by name and by synonym, twice
    assert metrics.absent == 12
    monkeypatch.setattr(card, "_SCENES", 1)
    table = card.write_detector_card(config.model_dir, 0, command=config.command, size="a few")
    assert "| household, held-out categories |" in table
    written = (config.model_dir / "README.md").read_text(encoding="utf-8")
    assert table in written
    assert "owlxt5-backbones --part=detector --steps=30" in written
    assert "--images=48" in written

    more = BackbonesConfig(
        "detector", tmp_path / "more", 5, 8, 1e-4, images=48, seed=2, start_from=config.model_dir
    )
    _, more_losses = train_detector(more, TINY)
    assert max(more_losses) < min(losses[:5])  # it goes on, and does not begin again
    first, second = more.command.splitlines()
    assert first == config.command
    assert "--steps=5 " in second


def test_in_little_light_it_sees_what_it_sees_in_daylight() -> None:
    detector = ZeroShotDetector(EMBEDDED, None, None, EYES)
    objects = read_objects("claeo")[:3]
    names = [[item.name for item in objects]]
    simulation = TabletopSimulation(objects)
    scores = []
    for light in (1.0, 0.1):
        simulation.reset(names[0], SLOT_POSES, Conditions(light=light))
        image = torch.from_numpy(simulation.render(EYES, 240, 320).copy()).permute(2, 0, 1)[None]
        scores.append(detector({EYES: image}, names).score[0])
        dark = detector({EYES: image / 255}, names).score[0]
        torch.testing.assert_close(dark, scores[-1])  # whole numbers or shares of one
    simulation.close()
    assert (torch.stack(scores) >= detector.threshold).all()


def test_nothing_is_seen_without_light() -> None:
    detector = ZeroShotDetector(EMBEDDED, None, None, EYES)
    found = detector({EYES: torch.zeros(1, 3, 240, 320)}, [["mug"]])
    assert found.score.isfinite().all()
    assert found.score[0, 0] < detector.threshold


def test_an_image_that_is_looked_at_once_shows_the_same() -> None:
    detector = ZeroShotDetector(EMBEDDED, None, None, "eyes")
    observation = {"eyes": torch.rand(2, 3, 120, 160, generator=torch.Generator().manual_seed(0))}
    names = [["red cube", "mug"], ["ball", "blue cube"]]
    look, usual = detector.look(observation), detector.propose(observation, names)
    for _ in range(2):
        found = look(names)
        torch.testing.assert_close(found.score, usual.score, atol=1e-5, rtol=0)
        torch.testing.assert_close(found.box, usual.box)
