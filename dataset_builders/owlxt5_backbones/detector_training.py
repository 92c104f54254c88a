# SPDX-License-Identifier: Apache-2.0
"""How the detector is trained: its loss, and the choice of its score threshold."""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torchvision.ops import box_convert, generalized_box_iou_loss, sigmoid_focal_loss
from transformers import (  # type: ignore[attr-defined]
    Owlv2ForObjectDetection,
    Owlv2Processor,
    Trainer,
)

from .detector import predict_patches
from .detector_batches import Collator

_IMAGES_AT_ONCE = 32
_L1_WEIGHT, _GIOU_WEIGHT = 5.0, 2.0


def detection_loss(logits: Tensor, found: Tensor, positive: Tensor, boxes: Tensor, known: Tensor) -> Tensor:
    """Focal loss of the patches' scores, and OWLv2's two losses of the boxes.

    Args:
        logits: (batch, patches, queries).
        found: (batch, patches, 4) boxes, middle and edges.
        positive: (batch, patches, queries) bool.
        boxes: (batch, patches, 4) true boxes; zero where there is none.
        known: (batch, queries) bool; what is not known costs nothing.
    """
    focal = sigmoid_focal_loss(logits.float(), positive.float(), alpha=0.5, gamma=2.0, reduction="none")
    focal = (focal * known[:, None]).sum()
    real = boxes[..., 2] > 0
    mine, true = found[real].float(), boxes[real]
    distance = (mine - true).abs().sum(dim=-1)
    corners = [box_convert(each, "cxcywh", "xyxy") for each in (mine, true)]
    overlap = generalized_box_iou_loss(*corners)
    boxes_loss = (_L1_WEIGHT * distance + _GIOU_WEIGHT * overlap).sum() / max(len(distance), 1)
    return focal / positive.sum().clamp(min=1) + boxes_loss


class DetectorTrainer(Trainer):
    """transformers' trainer with the loss that OWLv2 lacks."""

    def compute_loss(
        self,
        model: nn.Module,
        inputs: dict[str, Any],
        return_outputs: bool = False,
        num_items_in_batch: Tensor | int | None = None,
    ) -> Any:
        """The loss of a batch of `Collator`."""
        truth = [inputs.pop(key) for key in ("positive", "boxes", "known")]
        # The trainer lowers the precision of the network's own call alone.
        with self.accelerator.autocast():
            logits, found = predict_patches(model, **inputs)
        loss = detection_loss(logits, found, *truth)
        return (loss, logits) if return_outputs else loss


@torch.no_grad()
def find_threshold(
    model: Owlv2ForObjectDetection,
    processor: Owlv2Processor,
    images: Sequence[Mapping[str, Any]],
    seed: int,
) -> float:
    """The score threshold at which false negatives and false positives are equally frequent.

    Args:
        model: The detector.
        processor: Its own.
        images: Rows of `scenes.RandomScenes.images` that the detector was not trained on.
        seed: Of the queries.
    """
    torch.manual_seed(seed)
    collate = Collator(processor, model.num_patches_width)
    scores, there = list[Tensor](), list[Tensor]()
    for start in range(0, len(images), _IMAGES_AT_ONCE):
        batch = collate([images[row] for row in range(start, min(start + _IMAGES_AT_ONCE, len(images)))])
        positive, known, _ = (batch.pop(key) for key in ("positive", "known", "boxes"))
        there.append(positive.any(dim=1)[known])
        scores.append(predict_patches(model, **batch)[0].sigmoid().amax(dim=1)[known])
    score, is_there = torch.cat(scores), torch.cat(there)
    candidates = torch.linspace(0.02, 0.98, 97)
    false_negatives = (score[is_there] < candidates[:, None]).float().mean(dim=1)
    false_positives = (score[~is_there] >= candidates[:, None]).float().mean(dim=1)
    return round(float(candidates[(false_negatives - false_positives).abs().argmin()]), 2)
