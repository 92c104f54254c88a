# SPDX-License-Identifier: Apache-2.0
"""The policy on a dataset: features, normalisation, lessons, loss, checkpoints."""

import copy
from pathlib import Path
from typing import Any

import pytest
import torch
from lerobot.configs import FeatureType, PolicyFeature, PreTrainedConfig
from lerobot.datasets import LeRobotDataset
from lerobot.datasets.dataset_tools import remove_feature
from lerobot.policies.factory import make_policy as lerobot_make_policy
from lerobot.policies.factory import make_pre_post_processors
from lerobot.utils.sample_weighting import UniformWeighter
from safetensors.torch import load_file

from lerobot_owlxt5.backbones.pretrained import EMBEDDED
from lerobot_owlxt5.commands import prompts
from lerobot_owlxt5.commands.parser import spoken
from lerobot_owlxt5.data.episode_store import EpisodeStore
from lerobot_owlxt5.data.normalization import share_joint_range
from lerobot_owlxt5.data.windows import recover_actions
from lerobot_owlxt5.mode_sampling import ModeSampler, sample_rngs
from lerobot_owlxt5.modeling_owlxt5 import OWLxT5Policy
from policy_helpers import (
    ENDS,
    EYES,
    HORIZON,
    load_batch,
    make_config,
    make_dataset,
    make_owlv2,
    make_policy,
    make_t5,
    observe,
    record_prompts,
    without_dropout,
)

pytestmark = pytest.mark.slow  # trains

FRAMES = [0, 7, 20, 33, 41, 50]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> LeRobotDataset:
    return make_dataset(tmp_path_factory.mktemp("dataset") / "data", episodes=6)


def make(dataset: LeRobotDataset, t5: Path, **options: Any) -> tuple[OWLxT5Policy, Any, Any]:
    """Policy and processors as lerobot-train makes them: features come from the dataset."""
    config = make_config(t5, **options)
    config.input_features = {}
    torch.manual_seed(0)
    policy = lerobot_make_policy(config, ds_meta=dataset.meta)
    return policy, *make_pre_post_processors(config, dataset_stats=dataset.meta.stats)


def test_only_camera_and_state_are_inputs(dataset: LeRobotDataset, t5: Path) -> None:
    policy, preprocessor, _ = make(dataset, t5)
    assert set(policy.config.input_features) == {EYES, "observation.state"}
    batch = load_batch(dataset.root, FRAMES, preprocessor)
    assert batch["action"].shape == (6, 10)
    assert batch["observation.objects"].max() > 1, "the boxes' names must not be normalised"
    for key in ("observation.state", "action"):
        assert torch.isfinite(batch[key]).all()
        assert batch[key].abs().max() <= 1 + 1e-5


def test_ground_truth_needs_no_camera(tmp_path: Path, dataset: LeRobotDataset, t5: Path) -> None:
    blind = remove_feature(dataset, EYES, output_dir=tmp_path / "blind", repo_id="test/blind")
    policy, preprocessor, _ = make(blind, t5)
    assert set(policy.config.input_features) == {"observation.state"}
    sighted, *_ = make(dataset, t5)
    batch = load_batch(dataset.root, FRAMES, preprocessor)
    expected = sighted.eval()(batch)[0]
    del batch[EYES]
    assert policy.eval()(batch)[0] == expected


def test_processors_scale_there_and_back(dataset: LeRobotDataset, t5: Path) -> None:
    _, preprocessor, postprocessor = make(dataset, t5)
    raw = load_batch(dataset.root, FRAMES, lambda batch: batch)
    scaled = load_batch(dataset.root, FRAMES, preprocessor)
    assert torch.allclose(postprocessor(scaled["action"]), raw["action"], atol=1e-3)


def test_a_constant_joint_forgives_a_small_deviation() -> None:
    stats = {
        "observation.state": {"min": torch.tensor([0.0, 5.0]), "max": torch.tensor([90.0, 5.0])},
        "action": {"min": torch.tensor([1.0, 5.0]), "max": torch.tensor([100.0, 5.0])},
    }
    shared = share_joint_range(stats)
    for key in stats:
        assert shared[key]["min"] == pytest.approx([0, 4.95])
        assert shared[key]["max"] == pytest.approx([100, 5.05])
    assert share_joint_range({"action": stats["action"]}) == {"action": stats["action"]}


def train_on(dataset: LeRobotDataset, checkpoint: Path) -> tuple[OWLxT5Policy, Any, Any]:
    """Policy and processors as lerobot-train makes them for --policy.path: with the dataset's statistics."""
    config = PreTrainedConfig.from_pretrained(checkpoint)
    config.pretrained_path = checkpoint
    policy = lerobot_make_policy(config, ds_meta=dataset.meta)
    features = {"features": config.output_features, "norm_map": config.normalization_mapping}
    both = {"features": {**config.input_features, **config.output_features}}
    statistics = {"stats": dataset.meta.stats}
    return policy, *make_pre_post_processors(
        config,
        checkpoint,
        dataset_stats=dataset.meta.stats,
        preprocessor_overrides={"normalizer_processor": features | both | statistics},
        postprocessor_overrides={"unnormalizer_processor": features | statistics},
    )


@pytest.mark.parametrize("follows", [(0.8, 0.0), (1.0, -5.0)])
def test_state_and_action_have_one_range_however_processors_are_made(
    t5: Path, tmp_path: Path, follows: tuple[float, float]
) -> None:
    dataset = make_dataset(tmp_path / "data", episodes=3, follows=follows)
    policy, *new = make(dataset, t5)
    policy.train().forward(load_batch(dataset.root, FRAMES[:3], new[0]))
    for each in (policy, *new):
        each.save_pretrained(tmp_path / "checkpoint")
    again = LeRobotDataset(dataset.repo_id, root=dataset.root)  # with the statistics of its files
    policy, *loaded = train_on(again, tmp_path / "checkpoint")
    policy.train().forward(load_batch(dataset.root, FRAMES[:3], loaded[0]))
    saved = make_pre_post_processors(policy.config, tmp_path / "checkpoint")
    pose = torch.linspace(-30, 90, 10)
    expected = new[0]({"observation.state": pose, "action": pose})["action"]
    for preprocessor, postprocessor in (new, loaded, saved):
        scaled = preprocessor({"observation.state": pose, "action": pose})
        assert torch.equal(scaled["observation.state"][0], scaled["action"][0])
        assert torch.equal(scaled["action"], expected)
        assert torch.allclose(postprocessor(scaled["action"]), pose, atol=1e-3)


def test_episodes_count_alike_though_long_ones_are_drawn_more_often(
    dataset: LeRobotDataset, t5: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy, preprocessor, _ = make(dataset, t5, mode_probabilities={"execute": 1.0})
    monkeypatch.setattr(
        policy.model.core.decoder,
        "forward",
        lambda context, visual, pose, steps: (
            torch.zeros(len(pose), steps, 10),
            torch.zeros(len(pose), steps),
        ),
    )
    epoch = load_batch(dataset.root, list(range(dataset.num_frames)), preprocessor)
    first_frames = load_batch(dataset.root, dataset.meta.episodes["dataset_from_index"][:], preprocessor)
    episodes = [
        actions[:length].square().mean().item()
        for actions, length in zip(*EpisodeStore(dataset.meta).actions(first_frames, HORIZON), strict=True)
    ]
    assert policy.eval()(epoch)[1]["joint_loss"] == pytest.approx(sum(episodes) / len(episodes), rel=1e-4)


@pytest.mark.parametrize("trained_along", [False, True])
def test_a_batch_teaches_what_its_parts_would_teach(
    dataset: LeRobotDataset, tmp_path: Path, trained_along: bool
) -> None:
    """As on several GPUs, whose gradients are averaged; each mode occurs, and lengths differ."""
    t5 = without_dropout(make_t5(tmp_path, dataset.root))
    policy, preprocessor, _ = make(dataset, t5, dropout=0.0, train_language_model=trained_along)
    policy.train()
    seed = policy.training_seed.clone()

    def teach(frames: list[int]) -> list[torch.Tensor]:
        policy.training_seed.copy_(seed)
        policy.zero_grad()
        loss, terms = policy.forward(load_batch(dataset.root, frames, preprocessor))
        loss.backward()
        gradients = [parameter.grad for parameter in policy.get_optim_params()]
        return [
            loss.detach(),
            *map(torch.tensor, terms.values()),
            *(g.clone() for g in gradients if g is not None),
        ]

    frames = torch.randperm(dataset.num_frames, generator=torch.Generator().manual_seed(0)).tolist()
    whole, *parts = (teach(part) for part in (frames, frames[::2], frames[1::2]))
    for one, *two in zip(whole, *parts, strict=True):
        assert torch.allclose(one, sum(two) / 2, atol=1e-5)


@pytest.mark.parametrize("mode", prompts.MODES)
def test_prompts_and_targets_of_a_mode(dataset: LeRobotDataset, mode: str) -> None:
    texts = EpisodeStore(dataset.meta).texts
    sampler = ModeSampler({mode: 1.0}, texts, names_objects=True, pseudo_names=False)
    batch = load_batch(dataset.root, FRAMES, lambda batch: batch)
    samples = sampler.sample(batch, sample_rngs(0, batch["index"]))
    assert (samples.mode == prompts.MODES.index(mode)).all()
    for task, episode, prompt, target in zip(
        batch["task"], batch["episode_index"].tolist(), samples.prompts, samples.targets, strict=True
    ):
        noun = task.split()[-1]
        accepted = {f"execute: {wording.replace('-', ' ')}" for wording in texts[episode].wordings}
        match mode:
            case "execute":
                assert prompt in accepted
            case "describe":
                assert prompt == f"describe: {noun}"
            case "repeat_action":
                assert prompt == "repeat action:"
            case "translate":
                assert prompt == f"Translate English to German: The Commission met {episode} times."
        match mode:
            case "describe":
                assert target == task
            case "repeat_language":
                assert prompt == f"repeat language: {target}" and f"execute: {target}" in accepted
            case "translate":
                assert target == f"Die Kommission trat {episode} Mal zusammen."
            case _:
                assert target == ""


def test_a_checkpoint_names_the_modes_that_training_drew(tmp_path: Path, t5: Path) -> None:
    silent = make_dataset(tmp_path / "data", episodes=2, texts=False)
    shares = {"execute": 0.5, "repeat_action": 0.4, "translate": 0.5}
    policy, preprocess, _ = make(silent, t5, mode_probabilities=shares)
    batch = load_batch(silent.root, [0, 3, 7, 9, 11, 14], preprocess)
    policy.eval().forward(batch)
    assert policy.config.trained_modes is None  # a look is no training
    for _ in range(5):
        policy.train().forward(batch)
    policy.save_pretrained(tmp_path / "checkpoint")
    loaded = OWLxT5Policy.from_pretrained(tmp_path / "checkpoint")
    assert loaded.config.trained_modes == ["execute", "repeat_action"]
    with pytest.raises(ValueError, match=r"'translate'.*on data with sentences"):
        loaded.translate(["The mug is here."])


@pytest.mark.parametrize(
    ("embedded", "learns", "wanted", "expected"),
    [
        (False, False, True, False),
        (False, True, True, True),
        (True, False, True, True),
        (True, False, False, False),
    ],
)
def test_only_a_small_language_model_meets_pseudo_names(
    dataset: LeRobotDataset,
    t5: Path,
    monkeypatch: pytest.MonkeyPatch,
    embedded: bool,
    learns: bool,
    wanted: bool,
    expected: bool,
) -> None:
    policy, preprocessor, _ = make(
        dataset,
        Path(EMBEDDED) if embedded else t5,
        train_language_model=learns,
        mode_probabilities={"describe": 1.0},
        made_up_names=wanted,
    )
    batch = load_batch(dataset.root, list(range(dataset.num_frames)), preprocessor)
    true = [f"describe: {task.split()[-1]}" for task in batch["task"]]
    asked = record_prompts(policy, monkeypatch)
    policy.train().forward(batch)
    assert any(prompt != unchanged for prompt, unchanged in zip(asked, true, strict=True)) == expected
    asked.clear()
    policy.eval().forward(batch)
    assert asked == true


def test_describe_repeats_a_pseudo_name(dataset: LeRobotDataset) -> None:
    sampler = ModeSampler({"describe": 1.0}, {}, names_objects=True, pseudo_names=True)
    batch = load_batch(dataset.root, list(range(dataset.num_frames)), lambda batch: batch)
    samples = sampler.sample(batch, sample_rngs(0, batch["index"]))
    for prompt, target in zip(samples.prompts, samples.targets, strict=True):
        assert target.endswith(prompt.removeprefix("describe:"))


@pytest.mark.parametrize(
    ("mode", "renames"), [("execute", False), ("describe", False), ("repeat_language", True)]
)
def test_a_policy_that_looks_for_no_name_meets_pseudo_names_in_language_alone(
    dataset: LeRobotDataset, mode: str, renames: bool
) -> None:
    sampler = ModeSampler({mode: 1.0}, {}, names_objects=False, pseudo_names=True)
    batch = load_batch(dataset.root, list(range(dataset.num_frames)), lambda batch: batch)
    samples = sampler.sample(batch, sample_rngs(0, batch["index"]))
    said = samples.targets if mode == "describe" else [prompt.split(": ")[1] for prompt in samples.prompts]
    assert any(text != spoken(task) for text, task in zip(said, batch["task"], strict=True)) == renames


def test_a_batch_may_have_one_mode(dataset: LeRobotDataset) -> None:
    shares = {"execute": 0.5, "describe": 0.5}
    batch = load_batch(dataset.root, list(range(dataset.num_frames)), lambda batch: batch)
    drawn = [set[int](), set[int]()]
    for per_sample in (True, False):
        sampler = ModeSampler(shares, {}, names_objects=True, pseudo_names=False, per_sample=per_sample)
        for seed in range(8):
            modes = {*sampler.sample(batch, sample_rngs(seed, batch["index"])).mode.tolist()}
            assert len(modes) == (2 if per_sample else 1)
            drawn[per_sample] |= modes
    assert drawn[0] == drawn[1] == {prompts.EXECUTE, prompts.DESCRIBE}


def test_without_a_stop_output_a_plan_goes_on_and_nothing_is_learnt_of_its_end(
    dataset: LeRobotDataset, t5: Path
) -> None:
    policy, preprocessor, _ = make(dataset, t5, stop_output=False)
    batch = load_batch(dataset.root, FRAMES, preprocessor)
    policy.train().forward(batch)[0].backward()
    stop = policy.model.core.decoder.stop
    assert stop.weight.grad is None or not stop.weight.grad.any()
    torch.nn.init.constant_(stop.bias, 100.0)  # it would stop at once
    policy.eval()
    plan = policy.predict_action_chunk(batch)
    assert (plan.diff(dim=1) != 0).any(dim=-1).all()


def test_without_texts_the_other_modes_share(tmp_path: Path, t5: Path) -> None:
    plain = make_dataset(tmp_path / "plain", episodes=3, texts=False)
    policy, preprocessor, _ = make(plain, t5)
    batch = load_batch(plain.root, list(range(27)), preprocessor)
    sampler = ModeSampler(policy.config.mode_probabilities, {}, names_objects=True, pseudo_names=False)
    drawn = sampler.sample(batch, None).mode
    assert set(drawn.tolist()) == {prompts.EXECUTE, prompts.DESCRIBE, prompts.REPEAT_ACTION}
    policy.train()
    assert torch.isfinite(policy.forward(batch)[0])


def test_evaluation_is_deterministic_and_training_follows_its_seed(dataset: LeRobotDataset, t5: Path) -> None:
    policy, preprocessor, _ = make(dataset, t5)
    batch = load_batch(dataset.root, FRAMES, preprocessor)
    policy.eval()
    assert policy.forward(batch)[1] == policy.forward(batch)[1]
    policy.train()
    first, second = policy.forward(batch)[1], policy.forward(batch)[1]
    assert first != second
    policy.training_seed -= 2
    torch.manual_seed(123)
    state = torch.get_rng_state()
    assert policy.forward(batch)[1] == first
    assert torch.equal(torch.get_rng_state(), state), "other users of the generator must not notice"


def test_any_frame_of_an_episode_teaches_the_same(dataset: LeRobotDataset, t5: Path) -> None:
    policy, preprocessor, _ = make(dataset, t5, mode_probabilities={"repeat_action": 1.0})
    policy.eval()
    batches = [load_batch(dataset.root, [frame], preprocessor) for frame in (0, 3, 5)]
    losses = [policy.forward(batch)[0].item() for batch in batches]
    assert losses == pytest.approx([losses[0]] * 3)


def test_the_actions_in_memory_are_those_of_the_dataset(dataset: LeRobotDataset, t5: Path) -> None:
    _, preprocessor, _ = make(dataset, t5)
    batch = load_batch(dataset.root, FRAMES, preprocessor)
    finished = load_batch(dataset.root, FRAMES, preprocessor, finished=ENDS)
    expected, length = recover_actions(finished["action"], finished["action_is_pad"])
    stored, true_length = EpisodeStore(dataset.meta).actions(batch, HORIZON)
    assert torch.equal(length, true_length)
    assert torch.allclose(stored, expected, atol=1e-6)


def test_another_scale_is_noticed(dataset: LeRobotDataset, t5: Path) -> None:
    policy, preprocessor, _ = make(dataset, t5)
    for key in ("action", "observation.state"):
        batch = load_batch(dataset.root, FRAMES, preprocessor)
        batch[key] *= 0.9
        with pytest.raises(ValueError, match=r"scales state or action otherwise.*--policy\.path"):
            policy.forward(batch)


def test_the_loss_of_each_sample_can_be_weighted(dataset: LeRobotDataset, t5: Path) -> None:
    policy, preprocessor, _ = make(dataset, t5)
    batch = load_batch(dataset.root, FRAMES, preprocessor)
    weights, _ = UniformWeighter(torch.device("cpu")).compute_batch_weights(batch)
    (each, terms), (mean, same_terms) = policy.eval().forward(batch, reduction="none"), policy.forward(batch)
    assert each.shape == weights.shape == (len(FRAMES),)
    assert len(set(each.tolist())) > 1
    assert each.mean() == mean and terms == same_terms
    with pytest.raises(ValueError, match="'mean' or 'none', not 'sum'"):
        policy.forward(batch, reduction="sum")


def test_a_policy_knows_the_tasks_that_training_met(dataset: LeRobotDataset, t5: Path) -> None:
    policy, preprocessor, _ = make(dataset, t5)
    batch = load_batch(dataset.root, [0, 7], preprocessor) | {"task": ["wave at red", ""]}
    policy.eval().forward(batch)
    assert not policy.config.tasks
    policy.train().forward(batch)
    assert policy.config.tasks == ["wave at red"]
    policy.forward(load_batch(dataset.root, [7], preprocessor))
    assert policy.config.tasks == ["wave at red", dataset.meta.episodes[1]["tasks"][0]]


def test_only_episodes_that_are_met_must_fit_into_a_plan(
    dataset: LeRobotDataset, t5: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Episodes of 6, 9 and 12 steps; LeRobot does not tell the policy that the longest are left out."""
    policy, preprocessor, _ = make(dataset, t5, max_episode_steps=9)
    sentence = "Episode 2 of test/synthetic has 12 steps"
    assert sentence in caplog.text
    policy.train().forward(load_batch(dataset.root, [0, 7], preprocessor))
    assert policy.episodes is not None and policy.episodes.mean_length(9) == 7.5
    with pytest.raises(ValueError, match=rf"{sentence}.*--policy\.max_episode_steps=12.*--dataset\.episodes"):
        policy.forward(load_batch(dataset.root, [0, 20], preprocessor))


def test_training_needs_the_dataset(dataset: LeRobotDataset, t5: Path) -> None:
    _, preprocessor, _ = make(dataset, t5)
    with pytest.raises(ValueError, match="dataset_meta"):
        make_policy(t5).forward(load_batch(dataset.root, FRAMES, preprocessor))


@pytest.mark.parametrize("trained_along", [False, True])
def test_a_batch_can_be_learned_by_heart(dataset: LeRobotDataset, t5: Path, trained_along: bool) -> None:
    policy, preprocessor, _ = make(
        dataset, t5, train_language_model=trained_along, dropout=0.0, mode_probabilities={"execute": 1.0}
    )
    batch = load_batch(dataset.root, FRAMES, preprocessor)
    optimizer = torch.optim.Adam(policy.get_optim_params(), 1e-2)
    policy.train()
    losses = []
    for _ in range(60):
        loss, terms = policy.forward(batch)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        # Not the sum of all losses: a frozen T5 without knowledge cannot learn to speak.
        losses.append(terms["joint_loss"])
    assert terms["found"] == 1
    assert sum(losses[-10:]) < 0.5 * sum(losses[:10])


@pytest.mark.parametrize("trained_along", [False, True])
def test_a_checkpoint_holds_what_was_trained(
    dataset: LeRobotDataset, t5: Path, tmp_path: Path, trained_along: bool
) -> None:
    policy, _, _ = make(dataset, t5, train_language_model=trained_along, tasks=["wave"])
    with torch.no_grad():
        for parameter in policy.get_optim_params():
            parameter += 0.01 * torch.randn_like(parameter)
    policy.save_pretrained(tmp_path)
    stored = {".".join(key.split(".")[:2]) for key in load_file(tmp_path / "model.safetensors")}
    learned = {"model.core", "model.language_model"} if trained_along else {"model.core"}
    assert stored == {"training_seed", "rest_pose", "rest_tolerance"} | learned
    batch = observe(["push red", "pull ball"])
    for strict in (False, True):
        loaded = OWLxT5Policy.from_pretrained(tmp_path, strict=strict)
        assert loaded.config.tasks == policy.config.tasks
        assert torch.equal(loaded.predict_action_chunk(batch), policy.predict_action_chunk(batch))


def test_frozen_backbones_stay_as_they_are(dataset: LeRobotDataset, t5: Path, tmp_path: Path) -> None:
    policy, preprocessor, _ = make(dataset, t5, detector=str(make_owlv2(tmp_path)), score_threshold=0.0)
    batch = load_batch(dataset.root, FRAMES, preprocessor)
    policy.train()
    policy.forward(batch)[0].backward()
    for model in (policy.model.language.model, policy.visual.detector.model):
        assert not model.training
        assert all(parameter.grad is None for parameter in model.parameters())


def test_training_goes_on_after_an_evaluation_in_inference_mode(dataset: LeRobotDataset, t5: Path) -> None:
    policy, preprocessor, _ = make(dataset, t5, mode_probabilities={"execute": 1.0})
    batch = load_batch(dataset.root, [0], preprocessor)
    for wording in EpisodeStore(dataset.meta).texts[0].wordings:
        with torch.inference_mode():
            policy.reset()
            policy.select_action(observe([wording]))
    policy.train()
    policy.forward(batch)[0].backward()


def test_a_loss_that_is_no_number_names_its_episode(
    dataset: LeRobotDataset, t5: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy, preprocessor, _ = make(dataset, t5, mode_probabilities={"execute": 1.0})
    batch = load_batch(dataset.root, FRAMES, preprocessor)
    episode = batch["episode_index"][2].item()
    decode = policy.model.core.decoder.forward

    def diverge(context: torch.Tensor, visual: torch.Tensor, pose: torch.Tensor, steps: int) -> Any:
        actions, stop = decode(context, visual, pose, steps)
        return actions * torch.where(batch["episode_index"] == episode, torch.nan, 1.0)[:, None, None], stop

    monkeypatch.setattr(policy.model.core.decoder, "forward", diverge)
    with pytest.raises(FloatingPointError, match=rf"episodes \[{episode}\]"):
        policy.train().forward(batch)


# Errors -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("detector", "changes", "message"),
    [
        (
            "ground_truth",
            {"observation.state": (7,)},
            r"made for 10 joints, but 'observation\.state' .* \(7,\)",
        ),
        ("ground_truth", {"action": (7,), "observation.state": (7,)}, "must be of one size"),
        ("ground_truth", {"observation.state": None}, r"'observation\.state' .* --rename_map"),
        ("ground_truth", {"observation.objects": None}, "Name an OWLv2 with --policy.detector"),
        ("some/owlv2", {EYES: None}, f"looks through '{EYES}', but the dataset has no camera"),
    ],
)
def test_a_checkpoint_refuses_a_dataset_of_another_robot(
    dataset: LeRobotDataset, t5: Path, detector: str, changes: dict[str, Any], message: str
) -> None:
    meta = copy.deepcopy(dataset.meta)
    for key, shape in changes.items():
        if shape is None:
            del meta.features[key]
        else:
            meta.features[key]["shape"] = shape
    config = make_config(t5, detector=detector)  # with the features that it was trained with
    with pytest.raises(ValueError, match=message):
        lerobot_make_policy(config, ds_meta=meta)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"observation.state": None}, "needs the feature 'observation.state'"),
        ({"observation.state": (7,)}, "must be of one size"),
        ({EYES: None}, "has none"),
        (
            {EYES: None, "observation.images.a": (3, 8, 8), "observation.images.b": (3, 8, 8)},
            "--policy.camera",
        ),
    ],
)
def test_features_that_do_not_fit_are_refused(t5: Path, change: dict[str, Any], message: str) -> None:
    config = make_config(t5, detector="google/owlv2-base-patch16")
    for key, shape in change.items():
        config.input_features.pop(key, None)
        if shape:
            kind = FeatureType.VISUAL if "images" in key else FeatureType.STATE
            config.input_features[key] = PolicyFeature(kind, shape)
    with pytest.raises(ValueError, match=message):
        config.validate_features()


def test_the_camera_can_be_named(t5: Path) -> None:
    config = make_config(t5, camera="observation.images.side")
    with pytest.raises(ValueError, match=r"--policy.camera=observation.images.side"):
        config.validate_features()
    config.input_features["observation.images.side"] = PolicyFeature(FeatureType.VISUAL, (3, 8, 8))
    config.validate_features()
    assert config.camera_key == "observation.images.side"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mode_probabilities": {"dance": 1.0}}, "dance"),
        ({"mode_probabilities": {"translate": 1.0}}, "at least one mode"),
        ({"mode_probabilities": {"execute": -1.0, "describe": 1.0}}, "negative"),
        ({"max_episode_steps": 0}, "--policy.max_episode_steps"),
        ({"dim_model": 15}, "--policy.dim_model"),
    ],
)
def test_options_that_make_no_sense_are_refused(t5: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make_config(t5, **options)
