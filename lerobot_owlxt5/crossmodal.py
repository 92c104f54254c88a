# SPDX-License-Identifier: Apache-2.0
"""The crossmodal Transformer: language attends to action (paper, section 3)."""

import math

import torch
from torch import Tensor, nn


class CrossmodalTransformer(nn.Module):
    """One Transformer layer whose queries are language tokens and whose keys and values are action steps.

    Both sides are projected to the same width; the queries go through ReLU, layer norm and sinusoidal
    positions first. The layer has no self-attention. Sizes are those of the CrossT5 authors' configuration.
    """

    def __init__(
        self,
        dim_language: int,
        dim_action: int,
        dim_model: int,
        n_heads: int,
        dim_feedforward: int,
        dropout: float,
    ) -> None:
        super().__init__()
        self.queries = nn.Sequential(nn.Linear(dim_language, dim_model), nn.ReLU(), nn.LayerNorm(dim_model))
        self.keys = nn.Linear(dim_action, dim_model)
        self.attention = nn.MultiheadAttention(dim_model, n_heads, dropout=dropout, batch_first=True)
        self.feedforward = nn.Sequential(
            nn.Linear(dim_model, dim_feedforward),
            nn.ReLU(),
            nn.Dropout(dropout),
            nn.Linear(dim_feedforward, dim_model),
        )
        self.norm_attention = nn.LayerNorm(dim_model)
        self.norm_feedforward = nn.LayerNorm(dim_model)
        self.dropout = nn.Dropout(dropout)

    def forward(self, language: Tensor, action: Tensor) -> Tensor:
        """Attend.

        Args:
            language: (batch, tokens, dim_language).
            action: (batch, steps, dim_action).

        Returns:
            h: (batch, tokens, dim_model).
        """
        queries = self.queries(language)
        queries = self.dropout(queries + sinusoidal_positions(queries.shape[1], queries.shape[2]).to(queries))
        keys = self.keys(action)
        attended = self.attention(queries, keys, keys, need_weights=False)[0]
        h = self.norm_attention(queries + self.dropout(attended))
        return self.norm_feedforward(h + self.dropout(self.feedforward(h)))


def sinusoidal_positions(length: int, width: int) -> Tensor:
    """Positions p as sin(p / 10000^(2i/width)) and cos(...), of "Attention Is All You Need", section 3.5.

    Returns:
        (length, width), float32; sines in the even columns, cosines in the odd ones.
    """
    frequency = torch.exp(torch.arange(0, width, 2) * (-math.log(10000.0) / width))
    angle = torch.arange(length)[:, None] * frequency
    return torch.stack([angle.sin(), angle.cos()], dim=-1).flatten(1)
