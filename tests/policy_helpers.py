# SPDX-License-Identifier: Apache-2.0
"""Small datasets, backbones and policies for the tests of the policy."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from lerobot.configs import FeatureType, PolicyFeature
from lerobot.datasets import LeRobotDataset
from lerobot.datasets.language import language_feature_info
from torch.utils.data import default_collate
from transformers import (
    BertTokenizerFast,
    CLIPTokenizerFast,
    GroundingDinoConfig,
    GroundingDinoForObjectDetection,
    GroundingDinoImageProcessor,
    GroundingDinoProcessor,
    Owlv2Config,
    Owlv2ForObjectDetection,
    Owlv2ImageProcessor,
    Owlv2Processor,
    OwlViTConfig,
    OwlViTForObjectDetection,
    OwlViTImageProcessor,
    OwlViTProcessor,
    SwinConfig,
)

from lerobot_owlxt5.backbones.small_t5 import SmallT5Config, collect_texts, make_small_t5
from lerobot_owlxt5.configuration_owlxt5 import OWLxT5Config
from lerobot_owlxt5.modeling_crossmodal import CrossmodalPolicy
from lerobot_owlxt5.modeling_owlxt5 import OWLxT5Policy

# With models this small, threads would mostly wait for each other.
torch.set_num_threads(1)

EYES = "observation.images.eyes"
JOINTS = [f"{side}_{joint}.pos" for side in "rl" for joint in ("s_z", "s_y", "arm_x", "elbow_y", "wrist_z")]
HOME = np.array([0, -20, 0, -100, 0, 0, 20, 0, 100, 0], dtype=np.float32)
SYNONYMS = {"red": "scarlet", "green": "harlequin", "blue": "azure", "cyan": "greenish-blue"}
SLOT_X = (0.2, 0.5, 0.8)
HORIZON = 12
# First and last frame of an episode.
ENDS = [1 - HORIZON, HORIZON - 1]
LENGTHS = (6, 9, 12)


def object_features(names: list[str], x: tuple[float, ...] = SLOT_X) -> np.ndarray:
    """`observation.objects` (84,): boxes around (x, 0.45) and the names' bytes."""
    objects = np.zeros((3, 28), dtype=np.float32)
    for slot, name in enumerate(names):
        objects[slot, :4] = x[slot] - 0.05, 0.4, x[slot] + 0.05, 0.5
        objects[slot, 4 : 4 + len(name.encode())] = list(name.encode())
    return objects.reshape(-1)


def make_dataset(
    root: Path,
    episodes: int = 6,
    lengths: tuple[int, ...] = LENGTHS,
    texts: bool = True,
    follows: tuple[float, float] = (1.0, 0.0),
) -> LeRobotDataset:
    """A LeRobotDataset with CLANT's features: push and pull on three slots, some joints constant.

    The state `follows` the action by a factor and a term, as a follower arm does its leader.
    """
    rng = np.random.default_rng(0)
    features = {
        EYES: {"dtype": "image", "shape": (24, 48, 3), "names": ["height", "width", "channels"]},
        "observation.state": {"dtype": "float32", "shape": (10,), "names": JOINTS},
        "action": {"dtype": "float32", "shape": (10,), "names": JOINTS},
        "observation.objects": {"dtype": "float32", "shape": (84,), "names": None},
    }
    dataset = LeRobotDataset.create("test/synthetic", fps=10, features=features, root=root, use_videos=False)
    rows: list[list[dict[str, Any]]] = []
    for episode in range(episodes):
        verb, other = (("push", "move-up"), ("pull", "move-down"))[episode % 2]
        length, slot = lengths[episode % len(lengths)], episode % 3
        arrangement = rng.permutation(list(SYNONYMS))[:3].tolist()
        colour = arrangement[slot]
        share = np.arange(length)[:, None] / HORIZON
        q = HOME + share * np.array([0, 30 if verb == "push" else -30, 0, 20 * (slot - 1), 0, 0, 0, 0, 0, 0])
        q = q.astype(np.float32)
        for step in range(length):
            x = [SLOT_X[k] + (0.1 * step / length if k == slot else 0.0) for k in range(3)]
            dataset.add_frame(
                {
                    EYES: rng.integers(0, 255, (24, 48, 3), dtype=np.uint8),
                    "observation.state": np.float32(follows[0]) * q[step] + np.float32(follows[1]),
                    "action": q[min(step + 1, length - 1)],
                    "observation.objects": object_features(arrangement, tuple(x)),
                    "task": f"{verb} {colour}",
                }
            )
        dataset.save_episode()
        wordings = [f"{v} {c}" for c in (colour, SYNONYMS[colour]) for v in (verb, other)]
        rows.append(
            [_row("user", "task_aug", wording) for wording in wordings]
            + [_row("user", "translation", f"The Commission met {episode} times.")]
            + [_row("assistant", "translation", f"Die Kommission trat {episode} Mal zusammen.")]
        )
    dataset.finalize()
    if texts:
        _write_language(root, rows)
    return LeRobotDataset("test/synthetic", root=root)


def _row(role: str, style: str, content: str) -> dict[str, Any]:
    return {
        "role": role,
        "content": content,
        "style": style,
        "timestamp": 0.0,
        "camera": None,
        "tool_calls": None,
    }


def _write_language(root: Path, rows: list[list[dict[str, Any]]]) -> None:
    for path in root.glob("data/*/*.parquet"):
        table = pq.read_table(path)
        column = pa.array([rows[episode] for episode in table["episode_index"].to_pylist()])
        pq.write_table(table.append_column("language_persistent", column).replace_schema_metadata(None), path)
    info = root / "meta" / "info.json"
    content = json.loads(info.read_text())
    content["features"]["language_persistent"] = language_feature_info()["language_persistent"]
    info.write_text(json.dumps(content))


def make_t5(folder: Path, dataset_root: Path | None = None) -> Path:
    """A tiny T5."""
    config = SmallT5Config(folder, dataset_root, vocab_size=400, d_model=32, d_kv=8, d_ff=64, num_layers=1)
    make_small_t5(config, collect_texts(dataset_root))
    return folder


def without_dropout(t5: Path) -> Path:
    """Take a saved T5's dropout away: masks are drawn for a batch as a whole."""
    config = t5 / "config.json"
    config.write_text(json.dumps(json.loads(config.read_text()) | {"dropout_rate": 0.0}))
    return t5


def make_owlv2(folder: Path, **vision: int) -> Path:
    """A tiny OWLv2 with random weights; its tokenizer knows letters alone, and reads 32 of them."""
    letters = [*"abcdefghijklmnopqrstuvwxyz"]
    vocabulary = ["<|startoftext|>", "<|endoftext|>", *letters, *(f"{letter}</w>" for letter in letters)]
    tokenizer = CLIPTokenizerFast(
        vocab={token: i for i, token in enumerate(vocabulary)}, merges=[], model_max_length=32
    )
    small = {"hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 1, "num_attention_heads": 2}
    torch.manual_seed(0)
    config = Owlv2Config(
        text_config={
            **small,
            "vocab_size": len(vocabulary),
            "max_position_embeddings": 32,
            "eos_token_id": 1,
            "bos_token_id": 0,
        },
        vision_config={**small, "image_size": 32, "patch_size": 8, **vision},
        projection_dim=16,
    )
    Owlv2ForObjectDetection(config).save_pretrained(folder)
    size = config.vision_config.image_size
    Owlv2Processor(Owlv2ImageProcessor(size={"height": size, "width": size}), tokenizer).save_pretrained(
        folder
    )
    return folder


def make_owlvit(folder: Path) -> Path:
    """A tiny OWL-ViT with random weights: OWLv2's predecessor, which squeezes an image into its square."""
    make_owlv2(folder / "owlv2")
    v2 = Owlv2Config.from_pretrained(folder / "owlv2")
    texts, vision = v2.text_config.to_dict(), v2.vision_config.to_dict()
    config = OwlViTConfig(text_config=texts, vision_config=vision, projection_dim=16)
    OwlViTForObjectDetection(config).save_pretrained(folder)
    tokenizer = CLIPTokenizerFast.from_pretrained(folder / "owlv2")
    size = config.vision_config.image_size
    OwlViTProcessor(OwlViTImageProcessor(size={"height": size, "width": size}), tokenizer).save_pretrained(
        folder
    )
    return folder


def make_grounding_dino(folder: Path) -> Path:
    """A tiny Grounding DINO with random weights; its tokenizer knows eight words."""
    words = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", ".", "ball", "mug", "red", "cube", "wine", "bottle"]
    torch.manual_seed(0)
    config = GroundingDinoConfig(
        backbone_config=SwinConfig(
            embed_dim=8,
            depths=[1] * 4,
            num_heads=[1] * 4,
            window_size=4,
            image_size=64,
            out_features=["stage2", "stage3", "stage4"],
        ),
        text_config={
            "model_type": "bert",
            "vocab_size": len(words),
            "hidden_size": 16,
            "intermediate_size": 32,
            "num_hidden_layers": 1,
            "num_attention_heads": 2,
        },
        d_model=32,
        encoder_layers=1,
        decoder_layers=2,
        encoder_attention_heads=2,
        decoder_attention_heads=2,
        encoder_ffn_dim=32,
        decoder_ffn_dim=32,
        num_queries=8,
        max_text_len=16,
    )
    GroundingDinoForObjectDetection(config).save_pretrained(folder)
    tokenizer = BertTokenizerFast(vocab={word: index for index, word in enumerate(words)})
    images = GroundingDinoImageProcessor(size={"shortest_edge": 64, "longest_edge": 128})
    GroundingDinoProcessor(images, tokenizer).save_pretrained(folder)
    return folder


def small_options(language_model: Path) -> dict[str, Any]:
    """Options of a tiny policy of either kind."""
    return {
        "language_model": str(language_model),
        "max_episode_steps": HORIZON,
        "dim_model": 16,
        "n_heads": 2,
        "dim_feedforward": 32,
        "dim_lstm": 16,
        "max_text_tokens": 8,
        "device": "cpu",
        "push_to_hub": False,
    }


def make_config(language_model: Path, **options: Any) -> OWLxT5Config:
    """A tiny policy configuration with CLANT's features."""
    config = OWLxT5Config(**{"detector": "ground_truth", **small_options(language_model), **options})
    config.input_features = {
        EYES: PolicyFeature(FeatureType.VISUAL, (3, 24, 48)),
        "observation.state": PolicyFeature(FeatureType.STATE, (10,)),
        "observation.objects": PolicyFeature(FeatureType.STATE, (84,)),
    }
    config.output_features = {"action": PolicyFeature(FeatureType.ACTION, (10,))}
    return config


def make_policy(language_model: Path, **options: Any) -> OWLxT5Policy:
    """A tiny policy with reproducible weights."""
    torch.manual_seed(0)
    return OWLxT5Policy(make_config(language_model, **options))


def observe(tasks: list[str], objects: list[list[str]] | None = None) -> dict[str, Any]:
    """A batch of observations as lerobot-eval hands them over, after the preprocessor."""
    generator = torch.Generator().manual_seed(0)
    arrangements = objects or [["red", "ball", "mug"]] * len(tasks)
    return {
        EYES: torch.rand(len(tasks), 3, 24, 48, generator=generator),
        "observation.state": torch.rand(len(tasks), 10, generator=generator) - 0.5,
        "observation.objects": torch.tensor(np.stack([object_features(names) for names in arrangements])),
        "task": tasks,
    }


def record_prompts(policy: CrossmodalPolicy, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the language model is asked from now on."""
    asked: list[str] = []
    language = policy.model.language
    encode = language.encode
    monkeypatch.setattr(
        language, "encode", lambda prompts, device: asked.extend(prompts) or encode(prompts, device)
    )
    return asked


def load_batch(
    root: Path, indices: list[int], preprocessor: Any, finished: list[int] | None = None
) -> dict[str, Any]:
    """Frames of a dataset as lerobot-train hands them over, collated and preprocessed.

    Or with these frames (delta indices) and all actions of `finished` episodes, as for `describe`.
    """
    config = OWLxT5Config(max_episode_steps=HORIZON, device="cpu")
    observation = finished or config.observation_delta_indices
    keys = (EYES, "observation.state", "observation.objects")
    deltas = {key: [step / 10 for step in observation] for key in keys}
    if finished:
        deltas["action"] = [step / 10 for step in config.episode_delta_indices]
    dataset = LeRobotDataset("test/synthetic", root=root, delta_timestamps=deltas)
    items = [dataset[index] for index in indices]
    return preprocessor(
        default_collate([{k: v for k, v in item.items() if k != "language_persistent"} for item in items])
    )
