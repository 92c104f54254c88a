# SPDX-License-Identifier: Apache-2.0
"""The eyes: a small OWLv2, transformers' own class, and how it learns from rendered scenes."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
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
    TrainingArguments,
)

from .dice import pick
from .queries import PATTERNS, Objects, Query, all_texts, draw_queries

try:
    from timm.optim import Muon
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "making backbones needs timm: pip install 'lerobot_policy_owlxt5[backbones]'"
    ) from error

NOTHING, START, END = "<|nothing|>", "<|startoftext|>", "<|endoftext|>"
# Queries with colours and sides in a batch, beside all names.
_QUERIES = 96
_PICTURES_AT_ONCE = 32
_TEXT_TOKENS = 16
# Of the patches looked at so many are anywhere; in this share of the batches all are looked at, as later.
_ANY_PATCHES = 16
_ALL_PATCHES = 0.1
_FAR = 4.0  # more than any squared distance in a square with edges of 1
# Patches whose middle lies in this inner share of a box are to find it.
_INNER = 0.8
_L1_WEIGHT, _GIOU_WEIGHT = 5.0, 2.0
# AdamW's learning rate as a share of Muon's.
_ADAMW_SHARE = 0.4
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
        side: Patches along an edge of the eyes' picture.
        patches: How many patches of a picture are looked at, those with objects first, as in OWLv2's own
            training; all by default.
    """

    def __init__(self, processor: Owlv2Processor, side: int, patches: int | None = None) -> None:
        self._processor = processor
        self._edge = processor.image_processor.size["width"]  # type: ignore[attr-defined]
        self._side, self._patches = side, patches
        light = v2.ColorJitter(brightness=0.25, contrast=0.25, saturation=0.25)
        self._relight = v2.Compose([light, v2.GaussianNoise(sigma=0.02)])

    def __call__(self, rows: Sequence[Mapping[str, Any]]) -> dict[str, Tensor]:
        """Collate rows of `scenes.EyeWorld.pictures`.

        Returns:
            `pixel_values`; `input_ids` and `attention_mask` of the queries, which are asked of all pictures;
            `patches` (batch, patches), indices of those to look at; `says` (batch, patches, queries) bool,
            which of them are to say yes; `boxes` (batch, patches, 4), which box they are to find, middle and
            edges, shares of the padded square, zero where there is none; `known` (batch, queries), False
            where nobody could say what is meant.
        """
        random = np.random.default_rng(int(torch.randint(2**62, ())))
        images, pictures = [], []
        for row in rows:
            flipped = random.random() < 0.5
            images.append(self._prepare(np.array(row["image"]), flipped))
            objects = [dict(item) for item in row["objects"]]
            for item in objects if flipped else ():
                x0, y0, x1, y1 = item["box"]
                item["box"] = [1 - x1, y0, 1 - x0, y1]
            pictures.append(objects)
        queries = draw_queries(pictures, random, _QUERIES)
        number = self._side**2
        if self._patches and random.random() >= _ALL_PATCHES:
            number = min(number, self._patches)
        truth = [
            self._truth(objects, queries, number, image)
            for objects, image in zip(pictures, images, strict=True)
        ]
        keys = "patches", "says", "boxes", "known"
        stacked = {
            key: torch.stack(values) for key, values in zip(keys, zip(*truth, strict=True), strict=True)
        }
        texts = [pick(random, PATTERNS).format(query.phrase) for query in queries]
        inputs = self._processor(
            text=texts, images=images, do_rescale=False, truncation=True, return_tensors="pt"
        )
        return {**inputs, **stacked}

    def _prepare(self, pixels: NDArray[np.uint8], flipped: bool) -> Tensor:
        """As large as the eyes want it: OWLv2's processor, whose blur is slow, then has nothing to shrink."""
        image = torch.from_numpy(pixels).permute(2, 0, 1)
        height, width = image.shape[-2:]
        scale = self._edge / max(height, width)
        image = v2.functional.resize(image, [round(height * scale), round(width * scale)], antialias=False)
        image = self._relight(image.float() / 255).clamp(0, 1)
        return image.flip(-1) if flipped else image

    def _truth(
        self, objects: Objects, queries: Sequence[Query], number: int, image: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """`patches`, `says`, `boxes` and `known` of a picture.

        Our decision: a patch in the inner part of an object says so and finds its box. OWLv2's own set
        matching needs ten times the pictures where all boxes are known.
        """
        height, width = image.shape[-2:]
        corners = torch.tensor([item["box"] for item in objects]).view(-1, 4)
        boxes = box_convert(
            corners * torch.tensor([width, height, width, height]) / self._edge, "xyxy", "cxcywh"
        )
        middle = (torch.arange(self._side) + 0.5) / self._side
        patch = torch.stack(torch.meshgrid(middle, middle, indexing="xy"), dim=-1).view(-1, 1, 2)
        offset = (patch - boxes[:, :2]).abs()  # (patches, objects, 2)
        nearest = offset.square().sum(dim=-1)
        inner = (offset <= _INNER / 2 * boxes[:, 2:]).all(dim=-1)
        inner |= nearest == nearest.amin(dim=0, keepdim=True)
        touched = (offset <= (boxes[:, 2:] + 1 / self._side) / 2).all(dim=-1).any(dim=-1)
        rank = torch.rand(len(patch)) + touched
        rank[torch.randperm(len(patch))[:_ANY_PATCHES]] += 2
        patches = rank.topk(number).indices
        inner, nearest = inner[patches], nearest[patches]
        meant = torch.zeros(len(objects), len(queries))
        known = torch.ones(len(queries), dtype=torch.bool)
        for column, query in enumerate(queries):
            indices = query.meant(objects)
            known[column] = indices is not None
            meant[list(indices or ()), column] = 1
        # A patch in two boxes belongs to the nearer middle, one in none to a box of nothing.
        nearest = nn.functional.pad(nearest.masked_fill(~inner, torch.inf), (0, 1), value=_FAR)
        found = nn.functional.pad(boxes, (0, 0, 0, 1))[nearest.argmin(dim=-1)]
        return patches, inner.float() @ meant > 0, found, known


def look(
    model: Any,
    pixel_values: Tensor,
    input_ids: Tensor,
    attention_mask: Tensor,
    patches: Tensor,
) -> tuple[Tensor, Tensor]:
    """Ask the same of some patches of all pictures, each text being encoded once.

    Args:
        model: An `Owlv2ForObjectDetection`; its own call wants queries for each picture and all patches.
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
    pictures = model.layer_norm(encoded[:, 1:] * encoded[:, :1])
    texts = model.owlv2.get_text_features(input_ids, attention_mask).pooler_output
    logits, _ = model.class_predictor(pictures, texts.expand(len(pictures), -1, -1))
    return logits, (model.box_head(pictures) + model.box_bias[patches]).sigmoid()


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
