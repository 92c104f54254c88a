# SPDX-License-Identifier: Apache-2.0
"""Tests of the rival early_fusion: its tokens, its closed loop, and that it learns."""

import json
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from lerobot.datasets import LeRobotDataset
from lerobot.datasets.factory import resolve_delta_timestamps
from lerobot.policies.factory import make_policy as lerobot_make_policy
from lerobot.policies.factory import make_pre_post_processors
from torch.utils.data import default_collate

from commands import run
from lerobot_owlxt5 import EarlyFusionConfig, EarlyFusionPolicy
from lerobot_owlxt5.commands.prompts import execute_prompt
from lerobot_owlxt5.data.episode_ends import EpisodeEnds
from lerobot_owlxt5.data.episode_frames import EpisodeFrames
from lerobot_owlxt5.model.joint_bins import (
    BINS_PER_UNIT,
    N_BINS,
    ZERO_BIN,
    ordered_embeddings,
    to_bins,
    to_values,
)
from policy_helpers import EYES, observe

CHUNK, JOINTS = 3, 10
TINY = {
    "device": "cpu",
    "push_to_hub": False,
    "image_size": (16, 32),
    "chunk_size": CHUNK,
    "dim_model": 32,
    "n_heads": 2,
    "dim_feedforward": 64,
    "n_encoder_layers": 1,
    "n_decoder_layers": 1,
    "max_text_tokens": 8,
}
TASKS = ["push red", "could you push the greenish-blue cube, please?"]


def make(dataset: LeRobotDataset, **options: Any) -> tuple[EarlyFusionPolicy, Any, Any]:
    """Policy and processors as lerobot-train makes them, tiny and with reproducible weights."""
    torch.manual_seed(0)
    policy = lerobot_make_policy(EarlyFusionConfig(**{**TINY, **options}), ds_meta=dataset.meta)
    assert isinstance(policy, EarlyFusionPolicy)
    return policy, *make_pre_post_processors(policy.config, dataset_stats=dataset.meta.stats)


def load(dataset: LeRobotDataset, policy: EarlyFusionPolicy, indices: list[int]) -> dict[str, Any]:
    """Frames as lerobot-train hands them to the preprocessor."""
    windows = resolve_delta_timestamps(policy.config, dataset.meta)
    chosen = LeRobotDataset(dataset.repo_id, root=dataset.root, delta_timestamps=windows)
    items = [chosen[index] for index in indices]
    return default_collate([{k: v for k, v in item.items() if k != "language_persistent"} for item in items])


def record_tokens(policy: EarlyFusionPolicy, monkeypatch: pytest.MonkeyPatch) -> list[torch.Tensor]:
    """What T5 generates from now on, without the token that every sequence begins with."""
    made: list[torch.Tensor] = []
    generate = policy.model.t5.generate

    def record(**options: Any) -> torch.Tensor:
        tokens = generate(**options)
        made.append(tokens[:, 1:])
        return tokens

    monkeypatch.setattr(policy.model.t5, "generate", record)
    return made


# Tokens -----------------------------------------------------------------------------------------------------


@given(st.lists(st.floats(-1, 1, width=32), min_size=1))
def test_a_value_comes_back_within_half_a_bin(numbers: list[float]) -> None:
    values = torch.tensor(numbers)
    bins = to_bins(values)
    assert bins.min() >= 0 and bins.max() < N_BINS
    assert (to_values(bins) - values).abs().max() <= 0.5 / BINS_PER_UNIT + 1e-6
    assert torch.equal(to_bins(to_values(bins)), bins)


def test_zero_is_the_middle_of_a_bin_and_what_is_beyond_is_in_the_outermost() -> None:
    assert to_bins(torch.tensor([-7.0, -1.0, 0.0, 1.0, 7.0])).tolist() == [0, 1, 128, 255, 255]
    assert to_values(torch.tensor([1, 128, 255])).tolist() == [-1.0, 0.0, 1.0]


@pytest.mark.parametrize("width", [31, 128])
def test_a_bin_is_most_like_its_neighbours_to_begin_with(width: int) -> None:
    embeddings = ordered_embeddings(width)
    assert embeddings.shape == (N_BINS, width)
    assert embeddings.square().mean().item() == pytest.approx(1.0, abs=0.05)
    distances = torch.cdist(embeddings, embeddings)
    distances.fill_diagonal_(torch.inf)
    assert ((distances.argmin(dim=1) - torch.arange(N_BINS)).abs() == 1).all()


def test_execute_emits_bins_alone_and_the_other_modes_words_alone(
    dataset: LeRobotDataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy, *_ = make(dataset)
    tokens = record_tokens(policy, monkeypatch)
    # A word would come out as a displacement far below the range.
    displacements = policy.predict_action_chunk(observe(TASKS)) - observe(TASKS)["observation.state"][:, None]
    assert displacements.abs().max() <= N_BINS / 2 / BINS_PER_UNIT + 1e-6
    policy.describe({EYES: torch.rand(2, 4, 3, 24, 48)})
    policy.translate(["The mug is here."])
    assert len(tokens) == 2
    for each in tokens:
        assert (each < policy.model.n_words).all()


# Closed loop ------------------------------------------------------------------------------------------------


def test_a_chunk_is_carried_out_before_the_next_look(
    dataset: LeRobotDataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy, *_ = make(dataset)
    looks: list[torch.Tensor] = []
    decode = policy.model.generate_actions
    monkeypatch.setattr(
        policy.model, "generate_actions", lambda embeds, mask: looks.append(mask) or decode(embeds, mask)
    )
    chunk = policy.predict_action_chunk(observe(TASKS))
    assert chunk.shape == (2, CHUNK, JOINTS)
    looks.clear()
    actions = [policy.select_action(observe(TASKS)) for _ in range(CHUNK + 1)]
    assert torch.equal(torch.stack(actions[:CHUNK], dim=1), chunk)
    assert len(looks) == 2
    policy.reset()
    policy.select_action(observe(TASKS))
    assert len(looks) == 3


def test_image_joints_and_words_count(dataset: LeRobotDataset) -> None:
    policy, *_ = make(dataset)
    policy.eval()
    batch = observe(["push red"])
    prompts = [execute_prompt(task) for task in batch["task"]]
    image, state = batch[EYES][:, None], batch["observation.state"]
    actions = torch.zeros(1, CHUNK, JOINTS)

    def loss(words: list[str], image: torch.Tensor, state: torch.Tensor) -> float:
        return policy.model.action_loss(*policy.model.embed(words, image, state), actions).item()

    usual = loss(prompts, image, state)
    upside_down = image.flip(-2)  # the same pixels elsewhere
    others = [
        loss(["execute: push blue"], image, state),
        loss(prompts, upside_down, state),
        loss(prompts, image, -state),
    ]
    assert loss(prompts, image, state) == usual
    assert all(abs(other - usual) > 1e-5 for other in others)


def test_a_sample_does_not_depend_on_its_company(dataset: LeRobotDataset) -> None:
    policy, *_ = make(dataset)
    together = policy.predict_action_chunk(observe(TASKS))
    alone = {key: value[:1] for key, value in observe(TASKS).items()}
    assert torch.equal(policy.predict_action_chunk(alone), together[:1])


def test_another_robot_is_refused(dataset: LeRobotDataset) -> None:
    policy, *_ = make(dataset)
    batch = observe(["push red"])
    batch["observation.state"] = batch["observation.state"][:, :7]
    with pytest.raises(ValueError, match="7 numbers, and the policy was trained on 10 joints"):
        policy.select_action(batch)


def test_a_robot_that_holds_does_not_creep(dataset: LeRobotDataset, monkeypatch: pytest.MonkeyPatch) -> None:
    policy, *_ = make(dataset)
    policy.largest_displacement = torch.rand(JOINTS)
    hold = to_values(torch.full((1, CHUNK, JOINTS), ZERO_BIN))
    monkeypatch.setattr(policy.model, "generate_actions", lambda embeds, mask: hold)
    batch = observe(["push red"])
    batch["observation.state"][:] = torch.linspace(-1.3, 1.3, JOINTS)  # pushed beyond the range
    for _ in range(CHUNK):
        assert torch.equal(policy.select_action(batch), batch["observation.state"])


# Learning ---------------------------------------------------------------------------------------------------


def test_after_an_episodes_end_the_last_action_is_held(dataset: LeRobotDataset) -> None:
    policy, *_ = make(dataset)
    last = dataset.meta.episodes["dataset_to_index"][0] - 1
    batch = load(dataset, policy, [last])
    assert batch["action_is_pad"].tolist() == [[False] + [True] * (CHUNK - 1)]
    assert (batch["action"] == batch["action"][:, :1]).all()


def test_the_bins_cover_the_displacements_of_the_training_data(dataset: LeRobotDataset) -> None:
    policy, preprocess, _ = make(dataset)
    batch = preprocess(load(dataset, policy, [*range(dataset.num_frames)]))
    policy.eval().forward(batch)
    assert (policy.largest_displacement == 1).all()
    policy.train().forward(batch)
    displacements = (batch["action"] - batch["observation.state"][:, None]) / policy.largest_displacement
    largest = displacements.abs().amax(dim=(0, 1))
    moves = torch.arange(JOINTS) == 1  # of the first three episodes, see `make_dataset`
    moves[3] = True
    assert largest[moves].tolist() == pytest.approx([1.0, 1.0])
    assert (largest[~moves] == 0).all() and (policy.largest_displacement > 0).all()


def test_describe_learns_from_the_first_and_the_last_frame(dataset: LeRobotDataset) -> None:
    ends = EpisodeEnds(EpisodeFrames(dataset.meta), EYES, (24, 48)).read([2, 0, 2])
    for pair, episode in zip(ends, [2, 0, 2], strict=True):
        row = dataset.meta.episodes[episode]
        for frame, index in zip(pair, (row["dataset_from_index"], row["dataset_to_index"] - 1), strict=True):
            assert torch.allclose(frame / 255, dataset[index][EYES], atol=1 / 255)


def test_evaluation_is_deterministic_and_training_follows_its_seed(dataset: LeRobotDataset) -> None:
    policy, preprocess, _ = make(dataset)
    batch = preprocess(load(dataset, policy, [*range(dataset.num_frames)]))
    policy.eval()
    loss, terms = policy.forward(batch)
    assert policy.forward(batch)[1] == terms
    assert set(terms) == {"execute_loss", "describe_loss", "translate_loss"}
    each, _ = policy.forward(batch, reduction="none")
    assert each.shape == (dataset.num_frames,) and each.mean().item() == pytest.approx(loss.item())
    policy.train()
    first, second = policy.forward(batch)[1], policy.forward(batch)[1]
    assert first != second
    policy.training_seed -= 2
    torch.manual_seed(123)
    assert policy.forward(batch)[1] == first


def test_a_saved_checkpoint_moves_the_same(dataset: LeRobotDataset, tmp_path: Path) -> None:
    policy, *_ = make(dataset)
    policy.save_pretrained(tmp_path)
    torch.manual_seed(1)
    again = EarlyFusionPolicy.from_pretrained(tmp_path)
    assert again.config.tokenizer_revision
    expected = policy.predict_action_chunk(observe(TASKS))
    assert torch.equal(again.predict_action_chunk(observe(TASKS)), expected)
    with pytest.raises(ValueError, match="dataset_meta"):
        again.train().forward(observe(TASKS) | {"action": expected})


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["execute", "describe"])
def test_it_learns_a_few_samples_by_heart(
    dataset: LeRobotDataset, monkeypatch: pytest.MonkeyPatch, mode: str
) -> None:
    policy, preprocess, postprocess = make(dataset, dropout=0.0, mode_probabilities={mode: 1.0})
    monkeypatch.setattr(policy, "_texts", {})  # one wording for each task
    raw = load(dataset, policy, [0, 8, 20])
    batch = preprocess(raw)
    optimizer = torch.optim.AdamW(policy.get_optim_params(), lr=1e-2)
    for _ in range(120):
        loss, _ = policy.train().forward(batch)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    if mode == "execute":
        off = (policy.predict_action_chunk(batch) - batch["action"]).abs() / policy.largest_displacement
        assert (off <= 0.5 / BINS_PER_UNIT + 1e-5).float().mean() > 0.95
        assert torch.allclose(postprocess(policy.predict_action_chunk(batch)), raw["action"], atol=1.0)
    else:
        ends = EpisodeEnds(EpisodeFrames(dataset.meta), EYES, (24, 48)).read([0, 1, 2]) / 255
        assert policy.describe({EYES: ends}) == raw["task"]


@pytest.mark.slow
def test_lerobot_trains_and_evaluates_it(dataset: LeRobotDataset, tmp_path: Path) -> None:
    run(
        "lerobot-train",
        *("--policy.type=early_fusion", "--policy.device=cpu", "--policy.push_to_hub=false"),
        *("--policy.dim_model=32", "--policy.n_heads=2", "--policy.n_encoder_layers=1"),
        *("--policy.n_decoder_layers=1", "--dataset.repo_id=test/synthetic", "--batch_size=4"),
        *(f"--dataset.root={dataset.root}", "--num_workers=0", "--steps=2"),
        f"--output_dir={tmp_path / 'train'}",
    )
    checkpoint = tmp_path / "train" / "checkpoints" / "last" / "pretrained_model"
    run(
        "lerobot-eval",
        *(f"--policy.path={checkpoint}", "--policy.device=cpu", "--env.type=claeo", "--env.task=PUSH-L"),
        *("--env.observation_height=48", "--env.observation_width=64", "--env.episode_length=11"),
        *("--eval.n_episodes=1", "--eval.batch_size=1", f"--output_dir={tmp_path / 'eval'}"),
    )
    info = json.loads((tmp_path / "eval" / "eval_info.json").read_text())
    assert info["per_group"]["claeo"]["n_episodes"] == 1


# Options ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mode_probabilities": {"repeat_action": 1.0}}, "repeat_action"),
        ({"mode_probabilities": {"translate": 1.0}}, "execute or describe"),
        ({"mode_probabilities": {"execute": -1.0, "describe": 1.0}}, "negative"),
        ({"patch_size": 9}, "--policy.patch_size=9"),
        ({"chunk_size": 0}, "--policy.chunk_size"),
        ({"n_heads": 3}, "--policy.n_heads=3"),
    ],
)
def test_options_that_make_no_sense_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        EarlyFusionConfig(device="cpu", **options)


def test_a_renamed_camera_leaves_describe_out(dataset: LeRobotDataset) -> None:
    config = EarlyFusionConfig(**TINY)
    policy, *_ = make(dataset)
    features = dict(policy.config.input_features)
    config.input_features = {"observation.images.front": features.pop(EYES), **features}
    config.output_features = policy.config.output_features
    with pytest.raises(ValueError, match=r"not with --rename_map"):
        EarlyFusionPolicy(config, dataset_meta=dataset.meta)
    config.mode_probabilities = {"execute": 1.0}
    EarlyFusionPolicy(config, dataset_meta=dataset.meta)
