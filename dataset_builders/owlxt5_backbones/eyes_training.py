# SPDX-License-Identifier: Apache-2.0
"""How the eyes learn: their loss, their optimizer, and the score from which on they believe what they see."""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torchvision.ops import box_convert, generalized_box_iou_loss, sigmoid_focal_loss
from transformers import (  # type: ignore[attr-defined]
    Owlv2ForObjectDetection,
    Owlv2Processor,
    Trainer,
    TrainingArguments,
)

from .eyes import look
from .eyes_batches import Collator

try:
    from timm.optim import Muon
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "making backbones needs timm: pip install 'lerobot_policy_owlxt5[backbones]'"
    ) from error

_PICTURES_AT_ONCE = 32
_L1_WEIGHT, _GIOU_WEIGHT = 5.0, 2.0
# AdamW's learning rate as a share of Muon's.
_ADAMW_SHARE = 0.4


def detection_loss(logits: Tensor, found: Tensor, says: Tensor, boxes: Tensor, known: Tensor) -> Tensor:
    """Focal loss of what patches say, and OWLv2's two losses of the boxes.

    Args:
        logits: (batch, patches, queries).
        found: (batch, patches, 4) boxes, middle and edges.
        says: (batch, patches, queries) bool.
        boxes: (batch, patches, 4) true boxes; zero where there is none.
        known: (batch, queries) bool; what is not known costs nothing.
    """
    focal = sigmoid_focal_loss(logits.float(), says.float(), alpha=0.5, gamma=2.0, reduction="none")
    focal = (focal * known[:, None]).sum()
    real = boxes[..., 2] > 0
    mine, true = found[real].float(), boxes[real]
    distance = (mine - true).abs().sum(dim=-1)
    corners = [box_convert(each, "cxcywh", "xyxy") for each in (mine, true)]
    overlap = generalized_box_iou_loss(*corners)
    boxes_loss = (_L1_WEIGHT * distance + _GIOU_WEIGHT * overlap).sum() / max(len(distance), 1)
    return focal / says.sum().clamp(min=1) + boxes_loss


class EyesTrainer(Trainer):
    """transformers' trainer with the loss that OWLv2 lacks, and with Muon.

    Muon takes the matrices of the Transformers' layers; AdamW what is left. On our pictures it needs half of
    AdamW's steps.

    Args:
        args: Of the training; `learning_rate` is Muon's.
        **kwargs: The trainer's other arguments.
    """

    def __init__(self, model: nn.Module, args: TrainingArguments, **kwargs: Any) -> None:
        named = [*model.named_parameters()]
        matrices = [weight for name, weight in named if weight.ndim == 2 and ".layers." in name]
        rest = [weight for name, weight in named if weight.ndim != 2 or ".layers." not in name]
        groups = [
            {"params": matrices},
            {"params": rest, "use_fallback": True, "lr": _ADAMW_SHARE * args.learning_rate},
        ]
        options = {
            "params": groups,
            "lr": args.learning_rate,
            "weight_decay": args.weight_decay,
            "betas": (args.adam_beta1, args.adam_beta2),
            "nesterov": True,
        }
        super().__init__(model, args, optimizer_cls_and_kwargs=(Muon, options), **kwargs)

    def compute_loss(
        self,
        model: nn.Module,
        inputs: dict[str, Any],
        return_outputs: bool = False,
        num_items_in_batch: Tensor | int | None = None,
    ) -> Any:
        """The loss of a batch of `Collator`."""
        truth = [inputs.pop(key) for key in ("says", "boxes", "known")]
        # The trainer lowers the precision of the network's own call alone.
        with self.accelerator.autocast():
            logits, found = look(model, **inputs)
        loss = detection_loss(logits, found, *truth)
        return (loss, logits) if return_outputs else loss


@torch.no_grad()
def find_threshold(
    model: Owlv2ForObjectDetection,
    processor: Owlv2Processor,
    pictures: Sequence[Mapping[str, Any]],
    seed: int,
) -> float:
    """The score that best tells what is there from what is not: as many of both are mistaken for the other.

    Args:
        model: The eyes.
        processor: Theirs.
        pictures: Rows of `scenes.EyeWorld.pictures` that the eyes were not trained on.
        seed: Of the questions.
    """
    torch.manual_seed(seed)
    collate = Collator(processor, model.num_patches_width)
    scores, there = list[Tensor](), list[Tensor]()
    for start in range(0, len(pictures), _PICTURES_AT_ONCE):
        batch = collate(
            [pictures[row] for row in range(start, min(start + _PICTURES_AT_ONCE, len(pictures)))]
        )
        says, known, _ = (batch.pop(key) for key in ("says", "known", "boxes"))
        there.append(says.any(dim=1)[known])
        scores.append(look(model, **batch)[0].sigmoid().amax(dim=1)[known])
    score, is_there = torch.cat(scores), torch.cat(there)
    candidates = torch.linspace(0.02, 0.98, 97)
    missed = (score[is_there] < candidates[:, None]).float().mean(dim=1)
    dreamt = (score[~is_there] >= candidates[:, None]).float().mean(dim=1)
    return round(float(candidates[(missed - dreamt).abs().argmin()]), 2)
