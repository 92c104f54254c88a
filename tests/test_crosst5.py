# SPDX-License-Identifier: Apache-2.0
"""The baseline CrossT5: its autoencoder, its two trainings, and what it does without a detector."""

import json
import shutil
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from lerobot.datasets import LeRobotDataset, LeRobotDatasetMetadata
from lerobot.policies.factory import make_policy as lerobot_make_policy
from lerobot.policies.factory import make_pre_post_processors
from lerobot.transforms import ImageTransforms, ImageTransformsConfig
from safetensors.torch import load_file, save_file

from commands import run, run_anyway
from lerobot_owlxt5 import CrossT5AutoencoderConfig, CrossT5AutoencoderPolicy, CrossT5Config, CrossT5Policy
from lerobot_owlxt5.autoencoder_features import FEATURE_NOISE
from lerobot_owlxt5.data.episode_store import EpisodeStore
from lerobot_owlxt5.mode_sampling import ModeSampler
from lerobot_owlxt5.model.autoencoder import HEIGHT, WIDTH, ChannelSeparatedAutoencoder
from policy_helpers import (
    EYES,
    HORIZON,
    load_batch,
    make_policy,
    make_t5,
    observe,
    record_prompts,
    small_options,
)

pytestmark = pytest.mark.slow  # starts trainings

FRAMES = [0, 7, 20, 26]
WINDOW = list(range(1 - HORIZON, HORIZON))


def make_config(t5: Path, **options: Any) -> CrossT5Config:
    return CrossT5Config(**{**small_options(t5), **options})


@pytest.fixture(scope="module")
def autoencoder(tmp_path_factory: pytest.TempPathFactory, dataset: LeRobotDataset) -> Path:
    """A checkpoint of the first training, untrained."""
    torch.manual_seed(1)
    config = CrossT5AutoencoderConfig(device="cpu", push_to_hub=False)
    folder = tmp_path_factory.mktemp("autoencoder") / "pretrained_model"
    lerobot_make_policy(config, ds_meta=dataset.meta).save_pretrained(folder)
    return folder


def make(dataset: LeRobotDataset, t5: Path, autoencoder: Path, **options: Any) -> tuple[CrossT5Policy, Any]:
    """Policy and preprocessor as lerobot-train makes them for the second stage."""
    torch.manual_seed(0)
    config = make_config(t5, autoencoder=str(autoencoder), **options)
    policy = lerobot_make_policy(config, ds_meta=dataset.meta)
    return policy, make_pre_post_processors(config, dataset_stats=dataset.meta.stats)[0]


# Autoencoder ------------------------------------------------------------------------------------------------


def test_channels_do_not_mix() -> None:
    torch.manual_seed(0)
    autoencoder = ChannelSeparatedAutoencoder().eval()
    images = torch.rand(2, 3, HEIGHT, WIDTH)
    features = autoencoder.encode_frames(images)
    assert features.shape == (2, 30)
    images[:, 1] = torch.rand(HEIGHT, WIDTH)
    changed = (autoencoder.encode_frames(images) != features).any(dim=0)
    assert changed.unflatten(0, (3, 10)).any(dim=1).tolist() == [False, True, False]


def test_images_of_any_size_and_type_are_seen_alike() -> None:
    torch.manual_seed(0)
    autoencoder = ChannelSeparatedAutoencoder()
    small = torch.randint(0, 256, (2, 40, 3, HEIGHT, WIDTH), dtype=torch.uint8)
    features = autoencoder.encode_frames(small)
    assert features.shape == (2, 40, 30)
    large = small[:, :2].repeat_interleave(2, dim=-1).repeat_interleave(2, dim=-2)
    assert torch.allclose(autoencoder.encode_frames(large / 255), features[:, :2], atol=1e-5)


def test_reading_all_frames_gives_what_the_data_set_gives(folder: Path, dataset: LeRobotDataset) -> None:
    """Video and images; the features that training remembers are those that the policy sees in a batch."""
    for whole in (LeRobotDataset("local/clant", root=folder / "data"), dataset):
        episodes = dict(EpisodeStore(whole.meta).frames.read(EYES))
        assert list(episodes) == list(range(whole.num_episodes))
        for episode in (0, whole.num_episodes - 1):
            row = whole.meta.episodes[episode]
            assert len(episodes[episode]) == row["length"]
            for step in (0, row["length"] // 2, row["length"] - 1):
                item = whole[row["dataset_from_index"] + step]
                assert torch.allclose(episodes[episode][step] / 255, item[EYES], atol=2 / 255)


def test_a_frame_may_be_off_its_time_by_less_than_half_a_frame(folder: Path) -> None:
    """Whatever --tolerance_s says: LeRobot does not tell a policy."""
    meta = LeRobotDatasetMetadata("local/clant", root=folder / "data")
    [(_, expected)] = EpisodeStore(meta).frames.read(EYES, [1])
    start = f"videos/{EYES}/from_timestamp"
    meta.episodes = meta.episodes.map(lambda row: {start: row[start] + 0.002})
    [(episode, frames)] = EpisodeStore(meta).frames.read(EYES, [1])
    assert episode == 1 and torch.equal(frames, expected)


def test_a_finished_episode_is_seen_as_in_training(
    dataset: LeRobotDataset, t5: Path, autoencoder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy, preprocessor = make(dataset, t5, autoencoder)
    visual, tasks = policy.eval().visual, ["-"] * len(FRAMES)
    batch = load_batch(dataset.root, FRAMES, preprocessor)
    visual.encode_cached(batch, tasks, EpisodeStore(dataset.meta))
    assert (visual.lowest == -1).all(), "a look at other data must not change what a policy sees"
    policy.train()
    visual.encode_cached(batch, tasks, EpisodeStore(dataset.meta))
    policy.eval()
    cached = visual.encode_cached(batch, tasks, EpisodeStore(dataset.meta))
    assert cached.features.shape == (4, HORIZON, 30)
    assert cached.object_found.all()
    assert cached.features[:, 0].abs().max() <= 1 + 1e-3
    assert (visual.lowest < visual.highest).all()
    finished = load_batch(dataset.root, FRAMES, preprocessor, finished=WINDOW)
    assert policy.config.describe_delta_indices == WINDOW
    seen = visual.encode(finished, tasks).features
    assert torch.allclose(seen, cached.features, atol=1e-3)
    assert not torch.allclose(seen[:, 0], seen[:, 1])
    first = visual.encode(batch, tasks).features
    assert torch.allclose(first, seen[:, :1], atol=1e-3)

    def fail(images: torch.Tensor) -> torch.Tensor:
        raise AssertionError("frames must be encoded once")

    monkeypatch.setattr(policy.visual.autoencoder, "encode_frames", fail)
    policy.train()
    noisy = visual.encode_cached(batch, tasks, EpisodeStore(dataset.meta)).features
    assert (noisy - cached.features).std() == pytest.approx(FEATURE_NOISE, rel=0.1)


def test_the_autoencoder_learns_to_reconstruct_frames(folder: Path) -> None:
    meta = LeRobotDatasetMetadata("local/clant", root=folder / "data")
    torch.manual_seed(0)
    config = CrossT5AutoencoderConfig(optimizer_lr=4e-3, device="cpu", push_to_hub=False)
    policy = lerobot_make_policy(config, ds_meta=meta)
    frames = torch.cat([frames for _, frames in EpisodeStore(meta).frames.read(EYES)])[::200] / 255
    mean_image = 255 * frames.std(dim=0, correction=0).square().mean().sqrt().item()
    optimizer = policy.config.get_optimizer_preset().build(policy.get_optim_params())
    policy.train()
    for _ in range(250):
        loss, terms = policy.forward({EYES: frames})
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert terms["grey_levels"] < 0.95 * mean_image, "features must tell the frames apart"


# The second training ----------------------------------------------------------------------------------------


def test_a_checkpoint_holds_core_and_autoencoder(
    dataset: LeRobotDataset, t5: Path, autoencoder: Path, tmp_path: Path
) -> None:
    policy, preprocessor = make(dataset, t5, autoencoder)
    trained = load_file(autoencoder / "model.safetensors")
    before = {f"visual.{key}": value for key, value in trained.items()}
    state = policy.state_dict()
    assert all(torch.equal(state[key], value) for key, value in before.items())
    optimizer = torch.optim.Adam(policy.get_optim_params(), 1e-2)
    policy.train()
    policy.forward(load_batch(dataset.root, FRAMES, preprocessor))[0].backward()
    optimizer.step()
    for key, value in policy.state_dict().items():
        assert key not in before or torch.equal(value, before[key]), f"{key} must not learn"

    policy.save_pretrained(tmp_path)
    stored = {key.split(".")[0] for key in load_file(tmp_path / "model.safetensors")}
    assert stored == {"model", "visual", "training_seed", "rest_pose", "rest_tolerance"}
    config = json.loads((tmp_path / "config.json").read_text())
    (tmp_path / "config.json").write_text(json.dumps(config | {"autoencoder": "/gone"}))
    loaded = CrossT5Policy.from_pretrained(tmp_path, strict=True)
    batch = observe(["push red", "pull blue"])
    assert torch.equal(loaded.predict_action_chunk(batch), policy.predict_action_chunk(batch))


def test_only_a_command_that_is_not_known_is_refused(
    dataset: LeRobotDataset, t5: Path, autoencoder: Path
) -> None:
    policy, _ = make(dataset, t5, autoencoder)
    batch = observe(["push red", "pull the mug", "dance wildly"])
    plan = policy.predict_action_chunk(batch)
    assert policy.responses[:2] == ["I will push the red cube.", "I will pull the mug."]
    assert policy.responses[2].startswith(("I hold still", "Should I"))
    held = (plan == batch["observation.state"][:, None]).all(dim=(1, 2))
    assert held.tolist() == [False, False, True]


def test_the_plan_depends_on_the_image(dataset: LeRobotDataset, t5: Path, autoencoder: Path) -> None:
    policy, _ = make(dataset, t5, autoencoder)
    policy.config.tasks = ["push red"]
    batch = observe(["push red"])
    plan = policy.predict_action_chunk(batch)
    batch[EYES] = torch.zeros_like(batch[EYES])
    assert not torch.allclose(policy.predict_action_chunk(batch), plan)


def test_five_modes(
    dataset: LeRobotDataset, t5: Path, autoencoder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy, preprocessor = make(dataset, t5, autoencoder)
    batch = load_batch(dataset.root, list(range(27)), preprocessor)
    texts = EpisodeStore(dataset.meta).texts
    shares = policy.config.mode_probabilities
    sampler = ModeSampler(shares, texts, names_objects=policy.visual.names_objects, pseudo_names=False)
    assert {prompt.split(":")[0] for prompt in sampler.sample(batch, None).prompts} == {
        *("execute", "describe", "repeat action", "repeat language", "Translate English to German"),
    }
    asked = record_prompts(policy, monkeypatch)
    batch = load_batch(dataset.root, [0, 20], preprocessor, finished=WINDOW)
    answers = [
        policy.describe(batch),
        policy.repeat_language(["push red"]),
        policy.repeat_language(["push red", "pull blue"], batch),
        policy.translate(["Good morning."]),
    ]
    assert [len(texts) for texts in answers] == [2, 1, 2, 1]
    assert policy.repeat_action(batch).shape == (2, HORIZON, 10)
    assert asked == [
        *("describe:", "describe:", "repeat language: push red", "repeat language: push red"),
        *("repeat language: pull blue", "Translate English to German: Good morning."),
        *("repeat action:", "repeat action:"),
    ]


@pytest.mark.parametrize("reduction", ["mean", "none"])
def test_the_autoencoders_loss_can_be_weighted(
    dataset: LeRobotDataset, autoencoder: Path, reduction: str
) -> None:
    policy = CrossT5AutoencoderPolicy.from_pretrained(autoencoder)
    images = torch.rand(3, 3, 24, 48, generator=torch.Generator().manual_seed(0))
    one_by_one = torch.stack([policy.forward({EYES: image[None]})[0] for image in images])
    expected = one_by_one if reduction == "none" else one_by_one.mean()
    assert torch.allclose(policy.forward({EYES: images}, reduction=reduction)[0], expected)


def rename_camera(dataset: LeRobotDataset, folder: Path, other_eyes: bool) -> LeRobotDatasetMetadata:
    """The dataset with another name for its camera, and perhaps another camera that has the name now."""
    front = "observation.images.front"
    shutil.copytree(dataset.root, folder)
    for path in folder.glob("data/*/*.parquet"):
        table = pq.read_table(path)
        table = table.append_column(front, table[EYES])
        column = table.column_names.index(EYES)
        backwards = pa.array(table[EYES].to_pylist()[::-1], table[EYES].type)
        table = table.set_column(column, EYES, backwards) if other_eyes else table.remove_column(column)
        pq.write_table(table, path)
    info = json.loads((folder / "meta" / "info.json").read_text())
    info["features"][front] = info["features"][EYES] if other_eyes else info["features"].pop(EYES)
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    return LeRobotDatasetMetadata(dataset.repo_id, root=folder)


@pytest.mark.parametrize("other_eyes", [False, True])
def test_a_renamed_camera_is_found_in_the_dataset(
    dataset: LeRobotDataset, t5: Path, autoencoder: Path, tmp_path: Path, other_eyes: bool
) -> None:
    """With --rename_map the policy's name of a camera is not the dataset's, or that of another one there."""
    policy, preprocessor = make(dataset, t5, autoencoder)
    batch = load_batch(dataset.root, FRAMES, preprocessor)
    policy.train().forward(batch)
    expected = policy.visual.highest
    policy, _ = make(dataset, t5, autoencoder)
    policy.episodes = EpisodeStore(rename_camera(dataset, tmp_path / "data", other_eyes))
    policy.train().forward(batch)
    assert torch.equal(policy.visual.highest, expected)


# Errors -----------------------------------------------------------------------------------------------------


def test_transformed_images_are_refused(dataset: LeRobotDataset, t5: Path, autoencoder: Path) -> None:
    policy, preprocessor = make(dataset, t5, autoencoder)
    batch = load_batch(dataset.root, FRAMES, preprocessor)
    batch[EYES] = ImageTransforms(ImageTransformsConfig(enable=True))(batch[EYES])
    with pytest.raises(ValueError, match=r"--dataset\.image_transforms\.enable=false"):
        policy.train().forward(batch)


def test_an_autoencoder_that_cannot_be_had_are_refused(
    dataset: LeRobotDataset, t5: Path, autoencoder: Path, tmp_path: Path
) -> None:
    (tmp_path / "empty").mkdir()
    make(dataset, t5, autoencoder)[0].save_pretrained(tmp_path / "crossmodal")
    make_policy(t5).save_pretrained(tmp_path / "owlxt5")
    with pytest.raises(ValueError, match=r"set --policy\.autoencoder\. .*--policy\.type=crosst5_autoencoder"):
        lerobot_make_policy(make_config(t5), ds_meta=dataset.meta)
    for name, reason in (
        ("empty", "not found"),
        ("missing", ""),
        ("crossmodal", "another kind"),
        ("owlxt5", "another kind"),
    ):
        with pytest.raises(
            OSError, match=rf"--policy\.autoencoder=\S+/{name} .*{reason}.*=crosst5_autoencoder"
        ):
            make(dataset, t5, tmp_path / name)


def test_an_autoencoder_with_other_parameters_is_refused(autoencoder: Path, tmp_path: Path) -> None:
    shutil.copytree(autoencoder, tmp_path / "other")
    weights = load_file(autoencoder / "model.safetensors")
    name = next(iter(weights))
    weights["old_name"] = weights.pop(name)
    save_file(weights, tmp_path / "other" / "model.safetensors")
    with pytest.raises(RuntimeError, match=rf"(?s){name}.*old_name"):
        CrossT5AutoencoderPolicy.from_pretrained(tmp_path / "other")


# Stock commands ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of 12 episodes and a small T5."""
    folder = tmp_path_factory.mktemp("crosst5")
    size = ("--height=48", "--width=64", "--workers=1")
    run("owlxt5-dataset", f"--root={folder / 'data'}", "--arrangements=1", *size)
    make_t5(folder / "t5", folder / "data")
    return folder


def train(folder: Path, policy: str, *arguments: str) -> Path:
    """Train four steps; the last checkpoint."""
    run(
        "lerobot-train",
        *(f"--policy.type={policy}", "--policy.device=cpu", "--policy.push_to_hub=false"),
        *("--dataset.repo_id=local/clant", f"--dataset.root={folder / 'data'}"),
        *(
            "--batch_size=4",
            "--num_workers=0",
            "--steps=4",
            "--save_freq=2",
            f"--output_dir={folder / policy}",
            *arguments,
        ),
    )
    return folder / policy / "checkpoints" / "last" / "pretrained_model"


@pytest.fixture(scope="module")
def trained_autoencoder(folder: Path) -> Path:
    return train(folder, "crosst5_autoencoder")


@pytest.fixture(scope="module")
def checkpoint(folder: Path, trained_autoencoder: Path) -> Path:
    sizes = ("--policy.dim_model=32", "--policy.dim_feedforward=32", "--policy.dim_lstm=16")
    language = (f"--policy.language_model={folder / 't5'}", "--policy.train_language_model=true")
    return train(folder, "crosst5", *sizes, *language, f"--policy.autoencoder={trained_autoencoder}")


def evaluate(checkpoint: Path, env_type: str, output: Path) -> tuple[str, ...]:
    """Arguments of lerobot-eval."""
    return (
        *(f"--policy.path={checkpoint}", "--policy.device=cpu"),
        *(f"--env.type={env_type}", "--env.task=PUSH-L"),
        *("--env.observation_height=48", "--env.observation_width=64"),
        *("--eval.n_episodes=1", "--eval.batch_size=1", f"--output_dir={output}"),
    )


@pytest.mark.parametrize("env_type", ["clant", "claeo"])
def test_a_checkpoint_is_evaluated(folder: Path, checkpoint: Path, env_type: str) -> None:
    output = folder / f"eval_{env_type}"
    run("lerobot-eval", *evaluate(checkpoint, env_type, output))
    info = json.loads((output / "eval_info.json").read_text())
    assert info["per_group"][env_type]["n_episodes"] == 1


def test_a_resumed_run_encodes_again_and_ends_with_the_same_weights(
    folder: Path, trained_autoencoder: Path, checkpoint: Path
) -> None:
    before = load_file(checkpoint / "model.safetensors")
    assert all(tensor.isfinite().all() for tensor in before.values())
    for key, tensor in load_file(trained_autoencoder / "model.safetensors").items():
        assert torch.equal(tensor, before[f"visual.{key}"]), key
    config = folder / "crosst5" / "checkpoints" / "000002" / "pretrained_model" / "train_config.json"
    run("lerobot-train", f"--config_path={config}", "--resume=true")
    after = load_file(checkpoint / "model.safetensors")
    assert before.keys() == after.keys()
    for key, tensor in before.items():
        assert torch.equal(tensor, after[key]), key


def test_an_autoencoder_alone_cannot_be_evaluated(folder: Path, trained_autoencoder: Path) -> None:
    done = run_anyway("lerobot-eval", *evaluate(trained_autoencoder, "clant", folder / "eval_autoencoder"))
    assert done.returncode != 0
    assert "ValueError: This checkpoint is CrossT5's autoencoder alone and cannot act" in done.stdout
