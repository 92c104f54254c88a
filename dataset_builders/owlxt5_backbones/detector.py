# SPDX-License-Identifier: Apache-2.0
"""The detector: a small OWLv2, transformers' own class."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from tokenizers.pre_tokenizers import ByteLevel
from tokenizers.trainers import BpeTrainer
from torch import Tensor, nn
from transformers import (  # type: ignore[attr-defined]
    CLIPTokenizerFast,
    Owlv2Config,
    Owlv2ForObjectDetection,
    Owlv2ImageProcessor,
    Owlv2Processor,
)

from .queries import all_texts

NOTHING, START, END = "<|nothing|>", "<|startoftext|>", "<|endoftext|>"
_TEXT_TOKENS = 16
# On processors the fused attention's way back costs more than all other layers together.
_ATTENTION = "eager"
# Logits are (cosine + shift) * (1 + scale). Most patches mean nothing: say so from the start, gently.
_FIRST_SHIFT, _FIRST_SCALE = -0.4, 8.0


@dataclass(frozen=True)
class DetectorSizes:
    """Sizes of the network; the defaults are those of the detector that is shipped."""

    image_size: int = 256
    patch_size: int = 16
    width: int = 192
    layers: int = 8
    heads: int = 3
    text_width: int = 128
    text_layers: int = 2
    vocabulary: int = 1200


def make_detector_model(sizes: DetectorSizes, seed: int) -> tuple[Owlv2ForObjectDetection, Owlv2Processor]:
    """A network with random weights and its processor, whose tokenizer spells any text."""
    tokenizer = _fit_tokenizer(sizes.vocabulary)
    torch.manual_seed(seed)
    parts: dict[str, Any] = {
        "text_config": {
            "hidden_size": sizes.text_width,
            "intermediate_size": 4 * sizes.text_width,
            "num_hidden_layers": sizes.text_layers,
            "num_attention_heads": sizes.text_width // 32,
            "hidden_act": "gelu",
            "vocab_size": len(tokenizer),
            "max_position_embeddings": _TEXT_TOKENS,
            "bos_token_id": tokenizer.bos_token_id,
            "eos_token_id": tokenizer.eos_token_id,
            "pad_token_id": tokenizer.pad_token_id,
        },
        "vision_config": {
            "hidden_size": sizes.width,
            "intermediate_size": 4 * sizes.width,
            "num_hidden_layers": sizes.layers,
            "num_attention_heads": sizes.heads,
            "hidden_act": "gelu",
            "image_size": sizes.image_size,
            "patch_size": sizes.patch_size,
        },
        "projection_dim": sizes.text_width,
    }
    model = Owlv2ForObjectDetection(Owlv2Config(**parts))
    model.set_attn_implementation(_ATTENTION)
    # transformers draws their weights with a standard deviation of 1, as they are always loaded: boxes and
    # logits would be saturated from the start.
    for layer in (*model.box_head.modules(), *model.class_head.modules()):
        if isinstance(layer, nn.Linear):
            layer.reset_parameters()
    with torch.no_grad():
        for head in (model.class_head.logit_shift, model.class_head.logit_scale):
            head.weight.zero_()
        model.class_head.logit_shift.bias.fill_(_FIRST_SHIFT)
        model.class_head.logit_scale.bias.fill_(_FIRST_SCALE)
    side = {"height": sizes.image_size, "width": sizes.image_size}
    return model, Owlv2Processor(Owlv2ImageProcessor(size=side), tokenizer)


def load_detector_model(folder: Path) -> tuple[Owlv2ForObjectDetection, Owlv2Processor]:
    """A trained detector, ready for further training in full precision."""
    model = Owlv2ForObjectDetection.from_pretrained(folder, dtype=torch.float32, local_files_only=True)
    model.set_attn_implementation(_ATTENTION)
    return model, Owlv2Processor.from_pretrained(folder, local_files_only=True)


def _fit_tokenizer(vocabulary: int) -> CLIPTokenizerFast:
    letters = sorted(ByteLevel.alphabet())
    # OWLv2 takes a text whose first token has the number 0 for padding.
    special = (NOTHING, START, END)
    backend = CLIPTokenizerFast(
        vocab={token: k for k, token in enumerate(special)}, merges=[]
    ).backend_tokenizer
    trainer = BpeTrainer(
        vocab_size=vocabulary - len(letters),
        special_tokens=[*special],
        initial_alphabet=letters,
        end_of_word_suffix="</w>",
        show_progress=False,
    )
    backend.train_from_iterator(all_texts(), trainer)
    learnt = json.loads(backend.to_str())["model"]
    # A word that never came may end with any letter.
    tokens = [*learnt["vocab"], *(f"{letter}</w>" for letter in letters)]
    numbers = {token: number for number, token in enumerate(dict.fromkeys(tokens))}
    merges = [tuple(pair) for pair in learnt["merges"]]
    return CLIPTokenizerFast(vocab=numbers, merges=merges, model_max_length=_TEXT_TOKENS)


def predict_patches(
    model: Any,
    pixel_values: Tensor,
    input_ids: Tensor,
    attention_mask: Tensor,
    patches: Tensor,
) -> tuple[Tensor, Tensor]:
    """Ask the same of some patches of all images, each text being encoded once.

    Args:
        model: An `Owlv2ForObjectDetection`; its own call wants queries for each image and all patches.
        pixel_values: (batch, 3, height, width).
        input_ids: (queries, tokens).
        attention_mask: (queries, tokens).
        patches: (batch, patches), indices.

    Returns:
        Logits (batch, patches, queries) and boxes (batch, patches, 4), middle and edges.
    """
    vision = model.owlv2.vision_model
    # The class token comes first.
    kept = nn.functional.pad(patches + 1, (1, 0))
    embedded = vision.embeddings(pixel_values)
    embedded = embedded.gather(1, kept[..., None].expand(-1, -1, embedded.shape[-1]))
    encoded = vision.encoder(inputs_embeds=vision.pre_layernorm(embedded)).last_hidden_state
    encoded = vision.post_layernorm(encoded)
    images = model.layer_norm(encoded[:, 1:] * encoded[:, :1])
    texts = model.owlv2.get_text_features(input_ids, attention_mask).pooler_output
    logits, _ = model.class_predictor(images, texts.expand(len(images), -1, -1))
    return logits, (model.box_head(images) + model.box_bias[patches]).sigmoid()
