# SPDX-License-Identifier: Apache-2.0
"""The eyes: a small OWLv2, transformers' own class, and how it learns from rendered scenes."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from tokenizers.pre_tokenizers import ByteLevel
from tokenizers.trainers import BpeTrainer
from torch import Tensor, nn
from torchvision.ops import box_convert, generalized_box_iou_loss, sigmoid_focal_loss
from torchvision.transforms import v2
from transformers import (  # type: ignore[attr-defined]
    CLIPTokenizerFast,
    Owlv2Config,
    Owlv2ForObjectDetection,
    Owlv2ImageProcessor,
    Owlv2Processor,
    Trainer,
)

from .dice import pick
from .queries import PATTERNS, all_texts, draw_queries

NOTHING, START, END = "<|nothing|>", "<|startoftext|>", "<|endoftext|>"
# Queries with colours and sides in a batch, beside all names.
_QUERIES = 96
_PICTURES_AT_ONCE = 32
_TEXT_TOKENS = 16
# Patches whose middle lies in this inner share of a box are to find it.
_INNER = 0.8
_L1_WEIGHT, _GIOU_WEIGHT = 5.0, 2.0
# Logits are (cosine + shift) * (1 + scale). Most patches mean nothing: say so from the start, gently.
_FIRST_SHIFT, _FIRST_SCALE = -0.4, 8.0


@dataclass(frozen=True)
class EyesSizes:
    """Sizes of the network; the defaults are those of the eyes that are shipped."""

    image_size: int = 256
    patch_size: int = 16
    width: int = 192
    layers: int = 8
    heads: int = 3
    text_width: int = 128
    text_layers: int = 2
    vocabulary: int = 1200


def make_eyes(sizes: EyesSizes, seed: int) -> tuple[Owlv2ForObjectDetection, Owlv2Processor]:
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
    # On processors the fused attention's way back costs more than all other layers together.
    model.set_attn_implementation("eager")
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


class Collator:
    """Makes a batch of pictures, flipped and relit, with queries of their own.

    What it draws follows from PyTorch's generator, of which each worker of a data loader has its own.

    Args:
        processor: The eyes'.
    """

    def __init__(self, processor: Owlv2Processor) -> None:
        self._processor = processor
        light = v2.ColorJitter(brightness=0.25, contrast=0.25, saturation=0.25)
        self._relight = v2.Compose([light, v2.GaussianNoise(sigma=0.02)])

    def __call__(self, rows: Sequence[Mapping[str, Any]]) -> dict[str, Tensor]:
        """Collate rows of `scenes.EyeWorld.pictures`.

        Returns:
            `pixel_values`; `input_ids` and `attention_mask` of the queries, which are asked of all pictures;
            `boxes` (batch, objects, 4), middle and edges, shares of the padded square, zero where there is no
            object; `meant` (batch, objects, queries) bool; `known` (batch, queries), False where nobody could
            say what is meant.
        """
        random = np.random.default_rng(int(torch.randint(2**62, ())))
        images, pictures = [], []
        for row in rows:
            image = torch.from_numpy(np.array(row["image"])).permute(2, 0, 1).float() / 255
            objects = [dict(item) for item in row["objects"]]
            if random.random() < 0.5:
                image = image.flip(-1)
                for item in objects:
                    x0, y0, x1, y1 = item["box"]
                    item["box"] = [1 - x1, y0, 1 - x0, y1]
            images.append(self._relight(image).clamp(0, 1))
            pictures.append(objects)
        queries = draw_queries(pictures, random, _QUERIES)
        most = max(1, *(len(objects) for objects in pictures))
        boxes = torch.zeros(len(rows), most, 4)
        meant = torch.zeros(len(rows), most, len(queries), dtype=torch.bool)
        known = torch.ones(len(rows), len(queries), dtype=torch.bool)
        for sample, (image, objects) in enumerate(zip(images, pictures, strict=True)):
            height, width = image.shape[-2:]
            square = torch.tensor([width, height, width, height]) / max(height, width)
            corners = torch.tensor([item["box"] for item in objects]).view(-1, 4) * square
            boxes[sample, : len(objects)] = box_convert(corners, "xyxy", "cxcywh")
            for number, query in enumerate(queries):
                indices = query.meant(objects)
                known[sample, number] = indices is not None
                meant[sample, list(indices or ()), number] = True
        texts = [pick(random, PATTERNS).format(query.phrase) for query in queries]
        inputs = self._processor(
            text=texts, images=images, do_rescale=False, truncation=True, return_tensors="pt"
        )
        return {**inputs, "boxes": boxes, "meant": meant, "known": known}


def look(
    model: Any, pixel_values: Tensor, input_ids: Tensor, attention_mask: Tensor
) -> tuple[Tensor, Tensor]:
    """Ask the same of all pictures, each text being encoded once.

    Args:
        model: An `Owlv2ForObjectDetection`, whose own call wants queries for each picture.
        pixel_values: (batch, 3, height, width).
        input_ids: (queries, tokens).
        attention_mask: (queries, tokens).

    Returns:
        Logits (batch, patches, queries) and boxes (batch, patches, 4), middle and edges.
    """
    texts, pictures, _ = model.image_text_embedder(
        input_ids=input_ids, pixel_values=pixel_values, attention_mask=attention_mask
    )
    patches = pictures.flatten(1, 2)
    logits, _ = model.class_predictor(patches, texts.expand(len(patches), -1, -1))
    return logits, model.box_predictor(patches, pictures)


def detection_loss(logits: Tensor, found: Tensor, boxes: Tensor, meant: Tensor, known: Tensor) -> Tensor:
    """Loss of dense detection: each patch in the inner part of an object says so and finds its box.

    Our decision: OWLv2's own set matching needs ten times the pictures where all boxes are known.

    Args:
        logits: (batch, patches, queries).
        found: (batch, patches, 4) boxes, middle and edges.
        boxes: (batch, objects, 4) true boxes; zero where there is no object.
        meant: (batch, objects, queries) bool.
        known: (batch, queries) bool; what is not known costs nothing.
    """
    side = round(logits.shape[1] ** 0.5)
    middle = (torch.arange(side, device=boxes.device) + 0.5) / side
    patch = torch.stack(torch.meshgrid(middle, middle, indexing="xy"), dim=-1).view(-1, 2)
    offset = (patch[:, None] - boxes[:, None, :, :2]).abs()  # (batch, patches, objects, 2)
    real = boxes[..., 2] > 0
    inner = (offset <= _INNER / 2 * boxes[:, None, :, 2:]).all(dim=-1)
    nearest = offset.square().sum(dim=-1)
    inner |= nearest == nearest.amin(dim=1, keepdim=True)
    inner &= real[:, None]
    says = torch.einsum("bpo,boq->bpq", inner.float(), meant.float()) > 0
    focal = sigmoid_focal_loss(logits.float(), says.float(), alpha=0.5, gamma=2.0, reduction="none")
    focal = (focal * known[:, None]).sum()
    # A patch in two boxes belongs to the nearer middle.
    own = nearest.masked_fill(~inner, torch.inf).argmin(dim=-1)
    sample, place = inner.any(dim=-1).nonzero(as_tuple=True)
    true = boxes[sample, own[sample, place]]
    mine = found[sample, place].float()
    distance = (mine - true).abs().sum(dim=-1)
    corners = [box_convert(each, "cxcywh", "xyxy") for each in (mine, true)]
    overlap = generalized_box_iou_loss(*corners)
    boxes_loss = (_L1_WEIGHT * distance + _GIOU_WEIGHT * overlap).sum() / max(len(distance), 1)
    return focal / says.sum().clamp(min=1) + boxes_loss


class EyesTrainer(Trainer):
    """transformers' trainer with the loss that OWLv2 lacks."""

    def compute_loss(
        self,
        model: nn.Module,
        inputs: dict[str, Any],
        return_outputs: bool = False,
        num_items_in_batch: Tensor | int | None = None,
    ) -> Any:
        """The loss of a batch of `Collator`."""
        truth = [inputs.pop(key) for key in ("boxes", "meant", "known")]
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
    collate, scores, there = Collator(processor), list[Tensor](), list[Tensor]()
    for start in range(0, len(pictures), _PICTURES_AT_ONCE):
        batch = collate(
            [pictures[row] for row in range(start, min(start + _PICTURES_AT_ONCE, len(pictures)))]
        )
        meant, known, _ = (batch.pop(key) for key in ("meant", "known", "boxes"))
        there.append(meant.any(dim=1)[known])
        scores.append(look(model, **batch)[0].sigmoid().amax(dim=1)[known])
    score, is_there = torch.cat(scores), torch.cat(there)
    candidates = torch.linspace(0.02, 0.98, 97)
    missed = (score[is_there] < candidates[:, None]).float().mean(dim=1)
    dreamt = (score[~is_there] >= candidates[:, None]).float().mean(dim=1)
    return round(float(candidates[(missed - dreamt).abs().argmin()]), 2)
