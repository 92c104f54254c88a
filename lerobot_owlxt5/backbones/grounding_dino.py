# SPDX-License-Identifier: Apache-2.0
"""How Grounding DINO finds candidates: a caption lists what to look for."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torchvision.ops import box_convert

from .detections import Candidates


class GroundingDinoCandidates:
    """Grounding DINO: some hundred boxes, scored for each token of a caption that lists the names."""

    usual_threshold = 0.3

    def __init__(self, model: Any, processor: Any) -> None:
        self.model = model
        self.processor = processor
        self._full_stop = processor.tokenizer.convert_tokens_to_ids(".")
        self._longest = model.config.max_text_len

    def can_read(self, names: Sequence[str]) -> bool:
        """Whether the caption with all the names is no longer than what the model reads."""
        return len(self.processor.tokenizer(_caption(names))["input_ids"]) <= self._longest

    def __call__(self, images: Tensor, names: Sequence[Sequence[str]]) -> Candidates:
        """Propose boxes in images (batch, 3, height, width) in [0, 1]; a name's best token counts.

        Names that are too many for a caption are looked for in several.

        Raises:
            ValueError: If a name alone is too long.
        """
        found, start, total = [], 0, len(names[0])
        while start < total:
            stop = start + 1
            while stop < total and all(self.can_read(asked[start : stop + 1]) for asked in names):
                stop += 1
            box, score, _ = self._propose(images, [asked[start:stop] for asked in names])
            found.append((box, nn.functional.pad(score, (start, total - stop))))
            start = stop
        boxes, scores = zip(*found, strict=True)
        return Candidates(torch.cat(boxes, dim=1), torch.cat(scores, dim=1))

    def _propose(self, images: Tensor, names: Sequence[Sequence[str]]) -> Candidates:
        captions = [_caption(asked) for asked in names]
        inputs = self.processor(
            text=captions, images=list(images), do_rescale=False, padding=True, return_tensors="pt"
        ).to(images.device)
        outputs = self.model(**inputs)
        tokens = inputs["input_ids"]
        if tokens.shape[1] > outputs.logits.shape[-1]:
            raise ValueError(
                f"{names[0][0]!r} is too long for the detector, which reads captions of "
                f"{outputs.logits.shape[-1]} tokens: use fewer words."
            )
        ends = tokens == self._full_stop
        # Which name a token belongs to; the full stops and what begins and ends a caption belong to none.
        name = (ends.cumsum(dim=1) - ends.long()).masked_fill(ends | (inputs["attention_mask"] == 0), -1)
        name[:, 0] = -1
        of_token = outputs.logits[..., : tokens.shape[1]].sigmoid()
        scores = [
            of_token.masked_fill((name != number)[:, None], 0.0).amax(dim=-1)
            for number in range(len(names[0]))
        ]
        return Candidates(box_convert(outputs.pred_boxes, "cxcywh", "xyxy"), torch.stack(scores, dim=-1))


def _caption(names: Sequence[str]) -> str:
    return " ".join(f"{name} ." for name in names)
