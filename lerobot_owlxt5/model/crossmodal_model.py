# SPDX-License-Identifier: Apache-2.0
"""The network: prompts, visual features and joints go in, texts and movements come out."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ..backbones.language_model import SplitT5
from ..configuration_crossmodal import CrossmodalConfig
from .action import hold_after_stop
from .core import CrossmodalCore


class CrossmodalOutput(NamedTuple):
    """What language and action have become together.

    Attributes:
        language: l_enc, (batch, tokens, dim_language), T5's encoding of the prompts.
        mask: (batch, tokens) bool, False on padding.
        language_residual: FC(h), (batch, tokens, dim_language).
        context: Mean of h over the tokens, (batch, dim_model).
    """

    language: Tensor
    mask: Tensor
    language_residual: Tensor
    context: Tensor


class CrossmodalModel(nn.Module):
    """The split T5 with the crossmodal core in its middle (paper, figure 2).

    A frozen T5 is no part of the module tree, so it stays out of checkpoints, optimiser and gradient
    synchronisation. One that is trained along is registered as `language_model`.

    Args:
        config: Sizes and language model; which of the Hub's commits it is, is noted there.
        n_joints: Number of joints.
    """

    def __init__(self, config: CrossmodalConfig, n_joints: int) -> None:
        super().__init__()
        self.language = SplitT5(
            config.language_model, config.language_model_revision, frozen=not config.train_language_model
        )
        config.language_model_revision = self.language.revision
        if config.train_language_model:
            self.language_model = self.language.model
        self.core = CrossmodalCore(
            self.language.dim,
            config.dim_visual,
            n_joints,
            dim_model=config.dim_model,
            n_heads=config.n_heads,
            dim_feedforward=config.dim_feedforward,
            dropout=config.dropout,
            dim_lstm=config.dim_lstm,
            n_lstm_layers=config.n_lstm_layers,
        )
        self._max_text_tokens = config.max_text_tokens
        self._stop_output = config.stop_output

    def forward(self, prompts: Sequence[str], visual: Tensor, joints: Tensor) -> CrossmodalOutput:
        """Join prompts with visual features and joints.

        Args:
            prompts: One for each sample.
            visual: (batch, steps, dim_visual), or one step of what stays the same.
            joints: (batch, steps, n_joints), scaled to [-1, 1].
        """
        language, mask = self.language.encode(prompts, joints.device)
        return CrossmodalOutput(language, mask, *self.core(language, mask, visual, joints))

    def decode_actions(
        self, context: Tensor, visual: Tensor, pose: Tensor, steps: int
    ) -> tuple[Tensor, Tensor]:
        """Generate movements.

        Args:
            context: Of `forward`'s output, (batch, dim_model).
            visual: (batch, steps, dim_visual), or one step of what stays the same.
            pose: (batch, n_joints), the first pose, scaled to [-1, 1].
            steps: Number of steps to generate.

        Returns:
            Joint targets (batch, steps, n_joints) in [-1, 1], and stop logits (batch, steps).
        """
        movement: tuple[Tensor, Tensor] = self.core.decoder(context, visual, pose, steps)
        return movement

    @torch.no_grad()
    def plan(self, prompts: Sequence[str], visual: Tensor, joints: Tensor, steps: int) -> Tensor:
        """Answer prompts with movements, (batch, steps, n_joints), held after a stop output.

        See `forward` for the arguments.

        Raises:
            FloatingPointError: If a movement is not finite.
        """
        output: CrossmodalOutput = self(prompts, visual, joints)
        actions, stop_logits = self.decode_actions(output.context, visual, joints[:, 0], steps)
        if not actions.isfinite().all():
            raise FloatingPointError(
                "The planned movement is not finite, so nothing moves. Either the observation is not finite, "
                "or the checkpoint's weights are not, because its training diverged: load an earlier one."
            )
        return hold_after_stop(actions, stop_logits) if self._stop_output else actions

    def text_loss(self, output: CrossmodalOutput, targets: Sequence[str]) -> Tensor:
        """Cross entropy of T5's decoder, which attends to l_enc + FC(h): (batch,), in nats per token."""
        return self.language.text_loss(output.language + output.language_residual, output.mask, targets)

    @torch.no_grad()
    def generate_text(self, prompts: Sequence[str], visual: Tensor, joints: Tensor) -> list[str]:
        """Answer prompts with texts; see `forward` for the arguments."""
        output: CrossmodalOutput = self(prompts, visual, joints)
        encoding = output.language + output.language_residual
        return self.language.generate(encoding, output.mask, self._max_text_tokens)
