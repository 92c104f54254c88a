# SPDX-License-Identifier: Apache-2.0
"""Muon for transformers' trainer: the backbones need about half of AdamW's steps with it."""

from functools import partial
from importlib.util import find_spec
from typing import Any

import torch
from torch import nn
from transformers import TrainingArguments

# AdamW's learning rate as a share of Muon's.
_ADAMW_SHARE = 0.4
# Where transformers' OWLv2 and T5 keep their layers.
_LAYERS = (".layers.", ".block.")


def check_optimizer() -> None:
    """Check that Muon is there: better missing now than after an hour of rendering.

    Raises:
        ModuleNotFoundError: If the extra `backbones` (timm) is not installed.
    """
    if find_spec("timm") is None:
        raise ModuleNotFoundError(
            "making backbones needs timm: pip install 'lerobot_policy_owlxt5[backbones]'"
        )


def muon_options(model: nn.Module, args: TrainingArguments) -> tuple[type, dict[str, Any]]:
    """The trainer's `optimizer_cls_and_kwargs`: Muon for the layers' linear maps, AdamW for all else.

    Args:
        model: An OWLv2 or a T5.
        args: Of the training; `learning_rate` is Muon's.
    """
    from timm.optim import muon  # takes seconds: it imports all of timm's models

    if not args.bf16:
        # timm always orthogonalizes in bf16: three quarters of a step on a processor that emulates it.
        muon.zeropower_via_newtonschulz = partial(muon.zeropower_via_newtonschulz, dtype=torch.float32)
    matrices = [
        module.weight
        for name, module in model.named_modules()
        if isinstance(module, nn.Linear) and any(layers in name for layers in _LAYERS)
    ]
    mine = {id(weight) for weight in matrices}
    rest = [weight for weight in model.parameters() if id(weight) not in mine]
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
    return muon.Muon, options
