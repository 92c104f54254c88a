# SPDX-License-Identifier: Apache-2.0
"""One encoder-decoder for image patches, joints and words: its output is words or joints."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import cross_entropy, interpolate
from transformers import AutoTokenizer, T5Config, T5ForConditionalGeneration

from ..backbones.pretrained import EMBEDDED, find_backbone
from ..configuration_early_fusion import EarlyFusionConfig
from .joint_bins import N_BINS, ordered_embeddings, to_bins, to_values

IGNORED = -100
MOST_IMAGES = 2
"""Describe sees an episode's first frame and its last."""


class EarlyFusionModel(nn.Module):
    """A T5 with random weights, whose vocabulary is extended by one token for each bin.

    The encoder reads image patches with learnt places, then the joints as bin tokens, then the prompt. RT-2
    has no joints (our decision). The prompt comes last, so that padding is at the end and a sample does not
    depend on its company. T5 knows distances alone, so the decoder is told which joint and step is next (our
    decision), by the embedding that the same joint has in the encoder.

    Args:
        config: Sizes; which embedded language model the tokenizer is of, is noted there.
        n_joints: Number of joints.
    """

    def __init__(self, config: EarlyFusionConfig, n_joints: int) -> None:
        super().__init__()
        folder, config.tokenizer_revision = find_backbone(
            EMBEDDED, "language_model", config.tokenizer_revision
        )
        self.tokenizer = AutoTokenizer.from_pretrained(folder)
        self.n_words: int = len(self.tokenizer)
        self._size = config.image_size
        width = config.dim_model
        sizes: dict[str, Any] = {
            "vocab_size": self.n_words + N_BINS,
            "d_model": width,
            "d_kv": width // config.n_heads,
            "d_ff": config.dim_feedforward,
            "num_layers": config.n_encoder_layers,
            "num_decoder_layers": config.n_decoder_layers,
            "num_heads": config.n_heads,
            "dropout_rate": config.dropout,
            "pad_token_id": self.tokenizer.pad_token_id,
            "eos_token_id": self.tokenizer.eos_token_id,
            "decoder_start_token_id": self.tokenizer.pad_token_id,
        }
        self.t5: Any = T5ForConditionalGeneration(T5Config(**sizes))
        with torch.no_grad():
            self.t5.get_input_embeddings().weight[self.n_words :] = ordered_embeddings(width)
        self.patches = nn.Conv2d(3, width, config.patch_size, stride=config.patch_size)
        self.patch_norm = nn.LayerNorm(width)
        rows, columns = (side // config.patch_size for side in config.image_size)
        self.row = nn.Embedding(rows, width)
        self.column = nn.Embedding(columns, width)
        self.image = nn.Embedding(MOST_IMAGES, width)
        self.joint = nn.Embedding(n_joints, width)
        self.step = nn.Embedding(config.chunk_size, width)

    def embed(
        self, prompts: Sequence[str], images: Tensor | None = None, joints: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Turn what goes in into one sequence.

        Args:
            prompts: One for each sample.
            images: (batch, 1 or 2, 3, height, width), float in [0, 1] or uint8; or none.
            joints: (batch, joints), scaled to [-1, 1]; or none.

        Returns:
            (batch, tokens, dim_model), and a mask (batch, tokens), int64, 0 on padding.
        """
        device = self.row.weight.device
        words = self.tokenizer([*prompts], padding=True, return_tensors="pt").to(device)
        parts = [self._embed_images(images)] if images is not None else []
        if joints is not None:
            parts.append(self._embed_tokens(self.n_words + to_bins(joints)) + self.joint.weight)
        others = sum(part.shape[1] for part in parts)
        mask = nn.functional.pad(words["attention_mask"], (others, 0), value=1)
        return torch.cat([*parts, self._embed_tokens(words["input_ids"])], dim=1), mask

    def action_loss(self, embeds: Tensor, mask: Tensor, displacements: Tensor) -> Tensor:
        """Cross entropy of the tokens of chunks, averaged over each.

        Args:
            embeds: What `embed` returns, (batch, tokens, dim_model).
            mask: (batch, tokens).
            displacements: (batch, chunk_size, joints), scaled to [-1, 1].

        Returns:
            (batch,) in nats per token.
        """
        labels = self.n_words + to_bins(displacements).flatten(1)
        before = self.t5.prepare_decoder_input_ids_from_labels(labels)
        return self._loss(embeds, mask, self._embed_tokens(before) + self._next_joints(), labels)

    def text_loss(self, embeds: Tensor, mask: Tensor, texts: Sequence[str]) -> Tensor:
        """Cross entropy of the tokens of texts and of their ends, averaged over each.

        Returns:
            (batch,) in nats per token.
        """
        words = self.tokenizer([*texts], padding=True, return_tensors="pt").to(embeds.device)
        labels = words["input_ids"].masked_fill(words["attention_mask"] == 0, IGNORED)
        before = self.t5.prepare_decoder_input_ids_from_labels(labels)
        return self._loss(embeds, mask, self._embed_tokens(before), labels)

    def generate_actions(self, embeds: Tensor, mask: Tensor) -> Tensor:
        """Decode a chunk greedily; words cannot come out.

        Returns:
            Displacements (batch, chunk_size, joints), scaled to [-1, 1].
        """
        encoded = self.t5.get_encoder()(inputs_embeds=embeds, attention_mask=mask)
        tokens = [torch.full((len(embeds), 1), self.t5.config.decoder_start_token_id, device=embeds.device)]
        cache = None
        for next_joint in self._next_joints():
            # `generate` takes tokens alone, and no embeddings of the decoder's.
            output = self.t5(
                encoder_outputs=encoded,
                attention_mask=mask,
                decoder_inputs_embeds=self._embed_tokens(tokens[-1]) + next_joint,
                past_key_values=cache,
                use_cache=True,
            )
            cache = output.past_key_values
            tokens.append(self.n_words + output.logits[:, :, self.n_words :].argmax(dim=-1))
        bins = torch.cat(tokens[1:], dim=1) - self.n_words
        return to_values(bins).unflatten(1, (self.step.num_embeddings, -1))

    def generate_text(self, embeds: Tensor, mask: Tensor, max_new_tokens: int) -> list[str]:
        """Decode texts greedily; joints cannot come out."""
        tokens = self.t5.generate(
            inputs_embeds=embeds,
            attention_mask=mask,
            max_new_tokens=max_new_tokens,
            do_sample=False,
            suppress_tokens=[*range(self.n_words, self.n_words + N_BINS)],
        )
        return [text.strip() for text in self.tokenizer.batch_decode(tokens, skip_special_tokens=True)]

    def _embed_images(self, images: Tensor) -> Tensor:
        """Patches, row by row and image after image, (batch, images * patches, dim_model)."""
        batch, count = images.shape[:2]
        flat = images.flatten(0, 1)
        flat = flat / 255 if flat.dtype == torch.uint8 else flat
        patches = self.patches(2 * interpolate(flat, self._size, mode="area") - 1)
        patches = self.patch_norm(patches.permute(0, 2, 3, 1))  # (images, rows, columns, dim_model)
        patches = patches + self.row.weight[:, None] + self.column.weight
        patches = patches.unflatten(0, (batch, count)) + self.image.weight[:count, None, None]
        return patches.flatten(1, 3)

    def _loss(self, embeds: Tensor, mask: Tensor, before: Tensor, labels: Tensor) -> Tensor:
        logits = self.t5(inputs_embeds=embeds, attention_mask=mask, decoder_inputs_embeds=before).logits
        losses = cross_entropy(logits.float().transpose(1, 2), labels, reduction="none", ignore_index=IGNORED)
        return losses.sum(dim=1) / (labels != IGNORED).sum(dim=1)

    def _next_joints(self) -> Tensor:
        """What tells the decoder which token of a chunk is next, (chunk_size * joints, dim_model)."""
        return (self.step.weight[:, None] + self.joint.weight).flatten(0, 1)

    def _embed_tokens(self, tokens: Tensor) -> Tensor:
        return self.t5.get_input_embeddings()(tokens)
