# SPDX-License-Identifier: Apache-2.0
"""The modes (paper, section 3): which prompt asks for a mode, and how modes are drawn in training."""

import torch
from torch import Tensor

from .commands import spoken

# The last is CrossT5's alone: OWLxT5's paper dropped it, and its configuration never draws it.
MODES = ("execute", "describe", "repeat_action", "translate", "repeat_language")
EXECUTE, DESCRIBE, REPEAT_ACTION, TRANSLATE, REPEAT_LANGUAGE = range(len(MODES))

# The fractional part of its multiples is spread evenly over [0, 1).
GOLDEN_RATIO = 0.6180339887498949


def execute_prompt(command: str) -> str:
    """Ask for a command's movement."""
    return f"execute: {spoken(command)}"


def describe_prompt(label: str = "") -> str:
    """Ask what happened; to the object with this label, if a detector saw it move."""
    return f"describe: {spoken(label)}".strip()


def repeat_action_prompt() -> str:
    """Ask for the joint sequence that went in."""
    return "repeat action:"


def repeat_language_prompt(command: str) -> str:
    """Ask for the words that went in."""
    return f"repeat language: {spoken(command)}"


def translate_prompt(sentence: str) -> str:
    """Ask for a translation, with the prefix that T5 was pretrained with."""
    return f"Translate English to German: {sentence}"


def draw_modes(probabilities: Tensor, uniform: Tensor) -> Tensor:
    """Draw one mode per sample by inverting the cumulative distribution.

    Args:
        probabilities: (batch, modes), not negative, at least one above 0 in each row; need not sum to 1.
        uniform: (batch,) in [0, 1).

    Returns:
        (batch,) indices into `MODES`, int64.
    """
    cumulative = probabilities.cumsum(dim=1)
    threshold = uniform[:, None] * cumulative[:, -1:]
    return (cumulative <= threshold).sum(dim=1).clamp(max=len(MODES) - 1)


def spread(index: Tensor) -> Tensor:
    """Turn frame indices into evenly spread numbers in [0, 1): the same in each evaluation."""
    return torch.frac(index.double() * GOLDEN_RATIO)
