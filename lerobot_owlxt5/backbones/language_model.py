# SPDX-License-Identifier: Apache-2.0
"""T5, split between its encoder and its decoder (paper, section 3)."""

from collections.abc import Callable, Sequence
from typing import Any, Literal

import torch
from torch import Tensor
from torch.nn.functional import cross_entropy
from torch.nn.utils.rnn import pad_sequence
from transformers import AutoModelForSeq2SeqLM, AutoTokenizer
from transformers.modeling_outputs import BaseModelOutput

from .pretrained import EMBEDDED, find_backbone, load_pretrained

# Encodings in the cache: enough for CLANT's prompts, and at T5-small's size about 300 MB at the very most.
MAX_CACHED = 4096
IGNORED = -100


class SplitT5:
    """T5's encoder and decoder, with room between them.

    Deliberately not a `torch.nn.Module`: as long as T5 is frozen, it stays out of the policy's module tree
    and so out of checkpoints, optimiser and gradient synchronisation. To train it, the policy registers
    `model`.

    Args:
        name: Hub id, folder, or `embedded`.
        revision: Hub revision, or what an embedded one was before; or None.
        frozen: Keep the weights fixed, and never encode the same prompt twice.
        part: Which of the policy's backbones it is.
    """

    def __init__(
        self,
        name: str,
        revision: str | None = None,
        *,
        frozen: bool = True,
        part: Literal["language_model", "understanding"] = "language_model",
    ) -> None:
        where = (
            f"--policy.{part}",
            f"{EMBEDDED}, or a folder that holds a T5 (python -m lerobot_owlxt5.backbones.small_t5)",
        )
        name, revision = find_backbone(name, part, revision)
        self.tokenizer = load_pretrained(AutoTokenizer, name, revision, *where)
        self.model: Any = load_pretrained(
            AutoModelForSeq2SeqLM, name, revision, *where, use_safetensors=True, dtype=torch.float32
        )
        # The Hub's commit, or the digest of embedded weights; None for a folder.
        self.revision: str | None = self.model.config._commit_hash or revision
        self.frozen = frozen
        if frozen:
            self.model.requires_grad_(False).eval()
        self._cache: dict[str, Tensor] = {}

    @property
    def dim(self) -> int:
        """Width of the encoding."""
        return self.model.config.d_model

    def encode(self, prompts: Sequence[str], device: torch.device) -> tuple[Tensor, Tensor]:
        """Encode prompts.

        Returns:
            l_enc (batch, tokens, dim), zero on padding, and a bool mask (batch, tokens), False on padding.
        """
        if not self.frozen:
            encodings = self._encode(prompts, device)
        else:
            new = [prompt for prompt in dict.fromkeys(prompts) if prompt not in self._cache]
            if new:
                if len(self._cache) + len(new) > MAX_CACHED:
                    self._cache.clear()
                    new = list(dict.fromkeys(prompts))
                # One by one and in full precision, so that an encoding never depends on which prompts came
                # along: a resumed run meets them in other company. A tensor made in inference mode could not
                # take part in a later training step.
                with (
                    torch.inference_mode(False),
                    torch.no_grad(),
                    torch.autocast(device.type, enabled=False),
                ):
                    self._cache |= {prompt: self._encode([prompt], device)[0] for prompt in new}
            encodings = [self._cache[prompt].to(device) for prompt in prompts]
        lengths = torch.tensor([len(encoding) for encoding in encodings], device=device)
        padded = pad_sequence(encodings, batch_first=True)
        return padded, torch.arange(padded.shape[1], device=device) < lengths[:, None]

    def text_loss(self, encoding: Tensor, mask: Tensor, texts: Sequence[str]) -> Tensor:
        """Cross entropy of the decoder's tokens, averaged over each text.

        Args:
            encoding: What the decoder attends to, (batch, tokens, dim).
            mask: (batch, tokens) bool.
            texts: Target texts; an empty one has the end-of-sequence token alone.

        Returns:
            (batch,) in nats per token.
        """
        losses, labelled = self._token_losses(encoding, mask, texts)
        return losses.sum(dim=1) / labelled.sum(dim=1)

    @torch.no_grad()
    def confidence(self, encoding: Tensor, mask: Tensor, texts: Sequence[str]) -> Tensor:
        """How probable a token of texts is as answers, their geometric mean; see `text_loss`.

        Returns:
            (batch,) in [0, 1].
        """
        return torch.exp(-self.text_loss(encoding, mask, texts))

    def _token_losses(self, encoding: Tensor, mask: Tensor, texts: Sequence[str]) -> tuple[Tensor, Tensor]:
        """Cross entropy of each token (batch, tokens), and which tokens count."""
        labels = self._tokenize(texts, encoding.device)
        targets = labels["input_ids"].masked_fill(labels["attention_mask"] == 0, IGNORED)
        hidden = self._on(encoding.device).get_decoder()(
            input_ids=self.model.prepare_decoder_input_ids_from_labels(targets),
            encoder_hidden_states=encoding,
            encoder_attention_mask=mask,
            use_cache=False,
        )[0]
        if self.model.config.scale_decoder_outputs:
            hidden = hidden * self.model.config.d_model**-0.5
        # The vocabulary is the widest layer by far: go through it only where there is something to compare.
        labelled = targets != IGNORED
        logits = self.model.get_output_embeddings()(hidden[labelled]).float()
        losses = torch.zeros_like(targets, dtype=logits.dtype)
        losses[labelled] = cross_entropy(logits, targets[labelled], reduction="none")
        return losses, labelled

    def generate(
        self,
        encoding: Tensor,
        mask: Tensor,
        max_new_tokens: int,
        prefix_allowed_tokens_fn: Callable[[int, Tensor], list[int]] | None = None,
    ) -> list[str]:
        """Generate one text per sample, greedily.

        Args:
            encoding: What the decoder attends to, (batch, tokens, dim).
            mask: (batch, tokens) bool.
            max_new_tokens: Longest text, in tokens.
            prefix_allowed_tokens_fn: Which tokens may follow, as transformers' `generate` takes it.
        """
        tokens = self._on(encoding.device).generate(
            encoder_outputs=BaseModelOutput(last_hidden_state=encoding),  # type: ignore[arg-type]
            attention_mask=mask.long(),
            max_new_tokens=max_new_tokens,
            do_sample=False,
            num_beams=1,
            prefix_allowed_tokens_fn=prefix_allowed_tokens_fn,
        )
        return [text.strip() for text in self.tokenizer.batch_decode(tokens, skip_special_tokens=True)]

    def _encode(self, prompts: Sequence[str], device: torch.device) -> list[Tensor]:
        tokens = self._tokenize(prompts, device)
        hidden = self._on(device).get_encoder()(**tokens).last_hidden_state
        lengths = tokens["attention_mask"].sum(dim=1).tolist()
        return [sequence[:length] for sequence, length in zip(hidden, lengths, strict=True)]

    def _tokenize(self, texts: Sequence[str], device: torch.device) -> dict[str, Tensor]:
        tokens = self.tokenizer(list(texts), padding=True, return_tensors="pt")
        return {key: tokens[key].to(device) for key in ("input_ids", "attention_mask")}

    def _on(self, device: torch.device) -> Any:
        # A frozen model does not move with the policy, as it is not part of it.
        return self.model if self.model.device == device else self.model.to(device)
