# SPDX-License-Identifier: Apache-2.0
"""The mixed loss (paper, section 3), as functions of a model and a batch; nothing here draws or remembers.

For a sample of n true steps, a movement a(1) … a(L) and stop probabilities s(1) … s(L):

    joint    = mean over the n true steps and all joints of (decoded a - target)²
    stop     = mean over the L steps of the binary cross entropy of s to "the last step, or later"
    language = cross entropy of T5's decoder on l_enc + FC(h), per token
               in translate: mean of FC(h)² over true tokens, as T5's own encoding is to stay
    loss     = (mean length / n) · (language + joint_loss_weight · (joint + stop_loss_weight · stop))

LeRobot draws frames, so a long episode comes more often. The first factor makes every episode count the same,
as in the paper's epochs. A sample's loss depends on nothing else in its batch, so it does not matter how a
batch is split among GPUs.
"""

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from .commands.prompts import DESCRIBE, EXECUTE, MODES, REPEAT_ACTION, TRANSLATE
from .data.windows import positions_before, still
from .mode_sampling import ModeBatch
from .model.crossmodal_model import CrossmodalModel

STOP_LOSS_WEIGHT = 0.1
"""The stop output is our addition; it shares the action decoder, and must not outshout the joints there."""


class LossTerms(NamedTuple):
    """The loss of each sample, and what it is made of; all (batch,), weighted by the episode's length."""

    loss: Tensor
    joint: Tensor
    language: Tensor
    stop: Tensor

    def means(self) -> dict[str, float]:
        """What the loss is made of, for the log."""
        return {f"{name}_loss": getattr(self, name).mean().item() for name in ("joint", "language", "stop")}


def mixed_loss(
    model: CrossmodalModel,
    samples: ModeBatch,
    visual: Tensor,
    pose: Tensor,
    actions: Tensor,
    length: Tensor,
    *,
    mean_length: float,
    joint_loss_weight: float,
    stop_loss_weight: float = STOP_LOSS_WEIGHT,
) -> LossTerms:
    """Compute the loss of a batch, each sample in a mode of its own.

    Args:
        model: The model.
        samples: Modes, prompts and target texts.
        visual: (batch, L or 1, dim_visual), features of the episodes' frames.
        pose: (batch, joints), the first pose, scaled to [-1, 1].
        actions: (batch, L, joints), scaled, the last one held after the episode's end.
        length: (batch,) int64, true steps.
        mean_length: True steps of an episode of the dataset, on average. It scales all losses alike.
        joint_loss_weight: Weight of the action path beside the language; 1 in the paper.
        stop_loss_weight: Weight of the stop output beside the joints; 0 where there is none.
    """
    mode = samples.mode.to(pose.device)
    moves = (mode == EXECUTE) | (mode == REPEAT_ACTION)
    describes = mode == DESCRIBE
    visual = _choose(mode != TRANSLATE, visual, torch.zeros_like(visual))
    context, language = _forward_by_mode(model, samples, visual, pose, actions)

    # Where nothing moves, the decoder begins with the pose that it is to hold, in describe the last one.
    start = torch.where(describes[:, None], actions[:, -1], pose)
    target = _choose(moves, actions, start[:, None].expand_as(actions))
    # It sees the frames of a movement that it repeats, else one: nobody has seen a movement to come.
    seen = _choose(describes, visual[:, -1:], visual[:, :1])
    seen = _choose(mode == REPEAT_ACTION, visual, seen.expand_as(visual))
    decoded, stop_logits = model.decode_actions(context, seen, start, actions.shape[1])

    step = torch.arange(actions.shape[1], device=pose.device)
    error = (decoded - target).square().mean(dim=-1)
    joint = (error * (step < length[:, None])).sum(dim=1) / length
    # Where a pose is held, there is nothing to wait for: stop from the first step on.
    stopped = (step >= length[:, None] - 1) | ~moves[:, None]
    stop = binary_cross_entropy_with_logits(stop_logits, stopped.to(stop_logits), reduction="none").mean(
        dim=1
    )

    share = mean_length / length
    joint, language, stop = share * joint, share * language, share * stop
    loss = language + joint_loss_weight * (joint + stop_loss_weight * stop)
    return LossTerms(loss, joint, language, stop)


def reduce_loss(loss: Tensor, reduction: str) -> Tensor:
    """Reduce losses (batch,) as `forward` of LeRobot's policies does: `mean`, or `none`.

    Raises:
        ValueError: For another word.
    """
    if reduction not in ("mean", "none"):
        raise ValueError(f"`reduction` is 'mean' or 'none', not {reduction!r}.")
    return loss.mean() if reduction == "mean" else loss


def residual_loss(residual: Tensor, mask: Tensor) -> Tensor:
    """Translate's: mean((l_enc + FC(h) - l_enc)²) over true tokens, (batch,).

    Args:
        residual: FC(h), (batch, tokens, dim_language).
        mask: (batch, tokens) bool, False on padding.
    """
    weight = mask.unsqueeze(-1)
    return (residual.square() * weight).sum(dim=(1, 2)) / (weight.sum(dim=(1, 2)) * residual.shape[-1])


def _forward_by_mode(
    model: CrossmodalModel, samples: ModeBatch, visual: Tensor, pose: Tensor, actions: Tensor
) -> tuple[Tensor, Tensor]:
    """Context (batch, dim_model) and language loss (batch,) of all samples.

    The samples of a mode are of one kind, long prompts or short ones, movements or none: mode by mode,
    little work goes into padding.
    """
    chosen = [(samples.mode == mode).nonzero().flatten() for mode in range(len(MODES))]
    contexts, losses = [], []
    for mode, rows in enumerate(chosen):
        if not len(rows):
            continue
        prompts, targets = (
            [texts[row] for row in rows.tolist()] for texts in (samples.prompts, samples.targets)
        )
        if mode in (DESCRIBE, REPEAT_ACTION):
            seen, joints = visual[rows], positions_before(pose[rows], actions[rows])
        else:
            seen, joints = visual[rows][:, :1], still(pose[rows])
        output = model(prompts, seen, joints)
        contexts.append(output.context)
        losses.append(
            residual_loss(output.language_residual, output.mask)
            if mode == TRANSLATE
            else model.text_loss(output, targets)
        )
    in_order = torch.cat(chosen).argsort().to(pose.device)
    return torch.cat(contexts)[in_order], torch.cat(losses)[in_order]


def _choose(condition: Tensor, chosen: Tensor, other: Tensor) -> Tensor:
    """Choose between whole sequences (batch, steps, numbers) by a condition (batch,)."""
    return torch.where(condition[:, None, None], chosen, other)
