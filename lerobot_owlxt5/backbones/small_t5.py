# SPDX-License-Identifier: Apache-2.0
"""Make a small, untrained T5, so that the policy runs where no model hub can be reached.

    python -m lerobot_owlxt5.backbones.small_t5 --output_dir=outputs/small_t5 --dataset_root=data/clant

It knows nothing: train it along with `--policy.train_language_model=true`.
"""

import shlex
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import torch
from lerobot.datasets import LeRobotDatasetMetadata
from tokenizers import Tokenizer, decoders, pre_tokenizers, processors
from tokenizers.models import BPE
from tokenizers.trainers import BpeTrainer
from transformers import PreTrainedTokenizerFast, T5Config, T5ForConditionalGeneration

from ..command_line import check_numbers, command
from ..commands import prompts
from ..commands.parser import spoken
from ..commands.verbs import VERBS
from ..data.episode_store import EpisodeStore

PAD, END, UNKNOWN = "<pad>", "</s>", "<unk>"


@dataclass
class SmallT5Config:
    """Sizes of a small T5.

    Args:
        output_dir: Folder to write to; `--policy.language_model` takes it.
        dataset_root: LeRobotDataset whose texts the tokenizer is fitted to. Without one it knows the prompts
            alone; as it falls back to bytes, it can spell any text in any case.
        vocab_size: Most tokens that the tokenizer may have.
        d_model: Width.
        d_kv: Width of an attention head.
        d_ff: Width of the feed-forward layers.
        num_layers: Layers of the encoder, and of the decoder.
        num_heads: Attention heads.
        seed: Seed of the random weights.
    """

    output_dir: Path
    dataset_root: Path | None = None
    vocab_size: int = 1024
    d_model: int = 128
    d_kv: int = 32
    d_ff: int = 256
    num_layers: int = 2
    num_heads: int = 4
    seed: int = 0


def make_small_t5(config: SmallT5Config, texts: Iterable[str]) -> T5ForConditionalGeneration:
    """Fit a tokenizer to texts, draw random weights and save both.

    Args:
        config: Sizes and folder.
        texts: What the tokenizer should spell in few tokens.

    Returns:
        The model, as it was saved.
    """
    tokenizer = fit_tokenizer(texts, config.vocab_size)
    torch.manual_seed(config.seed)
    sizes = {
        "vocab_size": len(tokenizer),
        "d_model": config.d_model,
        "d_kv": config.d_kv,
        "d_ff": config.d_ff,
        "num_layers": config.num_layers,
        "num_heads": config.num_heads,
        "pad_token_id": tokenizer.pad_token_id,
        "eos_token_id": tokenizer.eos_token_id,
        "decoder_start_token_id": tokenizer.pad_token_id,
    }
    model = T5ForConditionalGeneration(T5Config(**sizes))
    tokenizer.save_pretrained(config.output_dir)
    model.save_pretrained(config.output_dir)
    return model


def fit_tokenizer(texts: Iterable[str], vocab_size: int) -> PreTrainedTokenizerFast:
    """Fit a byte-level BPE tokenizer, which ends each text with T5's end-of-sequence token."""
    tokenizer = Tokenizer(BPE())
    tokenizer.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=True)
    tokenizer.decoder = decoders.ByteLevel()
    trainer = BpeTrainer(
        vocab_size=vocab_size,
        special_tokens=[PAD, END, UNKNOWN],
        initial_alphabet=pre_tokenizers.ByteLevel.alphabet(),
        show_progress=False,
    )
    tokenizer.train_from_iterator(texts, trainer)
    tokenizer.post_processor = processors.TemplateProcessing(
        single=f"$A {END}", special_tokens=[(END, tokenizer.token_to_id(END))]
    )
    return PreTrainedTokenizerFast(
        tokenizer_object=tokenizer,
        pad_token=PAD,
        eos_token=END,
        unk_token=UNKNOWN,
        clean_up_tokenization_spaces=False,
    )


def collect_texts(dataset_root: Path | None) -> list[str]:
    """All prompts and answers that the policy meets in a dataset, or the bare prompts without one."""
    texts = [prompts.execute_prompt(verb) for verb in VERBS]
    texts += [prompts.describe_prompt(""), prompts.repeat_action_prompt(), prompts.translate_prompt("")]
    if dataset_root is None:
        return texts
    meta = LeRobotDatasetMetadata(dataset_root.name, root=dataset_root)
    texts += [spoken(task) for task in meta.tasks.index]
    for episode in EpisodeStore(meta).texts.values():
        texts += [prompts.execute_prompt(wording) for wording in episode.wordings]
        texts += [prompts.translate_prompt(episode.sentence)] if episode.sentence else []
    return texts


@command("small_t5")
def main(config: SmallT5Config) -> None:
    """Write a small T5 and say what to do with it."""
    if config.dataset_root is not None and not (config.dataset_root / "meta" / "info.json").is_file():
        raise ValueError(
            f"--dataset_root={config.dataset_root} holds no LeRobotDataset (no meta/info.json there)."
        )
    check_numbers(config, "vocab_size", "d_model", "d_kv", "d_ff", "num_layers", "num_heads")
    model = make_small_t5(config, collect_texts(config.dataset_root))
    print(
        f"Small untrained T5 ({model.num_parameters():,} parameters, {model.config.vocab_size} tokens) "
        f"is in {config.output_dir}.\nNext: lerobot-train --policy.type=owlxt5 "
        f"{shlex.quote(f'--policy.language_model={config.output_dir}')} --policy.train_language_model=true …"
    )


if __name__ == "__main__":
    main()
