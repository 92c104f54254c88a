# SPDX-License-Identifier: Apache-2.0
"""The crossmodal Transformer: language attends to action (paper, section 3)."""

import math

import torch
from torch import Tensor, nn


class CrossmodalTransformer(nn.Module):
    """One Transformer layer whose queries are language tokens and whose keys and values are action steps.

        x = norm(dropout(ReLU(W_q l_enc))) + positions
        y = norm(dropout(ReLU(W_k a_enc)))                  the same norm, no positions
        z = norm_attention(x + dropout(attention(x, y, y)))
        h = norm_feedforward(z + dropout(W_2 dropout(ReLU(W_1 z))))

    Both sides share one norm: without it, 35 times less of the action reaches h at the start. The layer has
    no self-attention. The equations, the sizes and the first weights are those of the CrossT5 authors' code.
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
        self.queries = nn.Linear(dim_language, dim_model)
        self.keys = nn.Linear(dim_action, dim_model)
        self.norm_inputs = nn.LayerNorm(dim_model)
        # No dropout on the attention weights, as in the authors' code.
        self.attention = nn.MultiheadAttention(dim_model, n_heads, batch_first=True)
        # PyTorch fills queries, keys and values as if they were one matrix, which makes them a third smaller.
        with torch.no_grad():
            for weight in (*self.attention.in_proj_weight.chunk(3), self.attention.out_proj.weight):
                nn.init.xavier_normal_(weight)
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
        queries = self._project(self.queries, language)
        queries = queries + sinusoidal_positions(queries.shape[1], queries.shape[2]).to(queries)
        keys = self._project(self.keys, action)
        attended = self.attention(queries, keys, keys, need_weights=False)[0]
        z = self.norm_attention(queries + self.dropout(attended))
        return self.norm_feedforward(z + self.dropout(self.feedforward(z)))

    def _project(self, linear: nn.Linear, inputs: Tensor) -> Tensor:
        """What language and action go through alike."""
        return self.norm_inputs(self.dropout(linear(inputs).relu()))


def sinusoidal_positions(length: int, width: int) -> Tensor:
    """Positions p as sin(p / 10000^(2i/width)) and cos(...), of "Attention Is All You Need", section 3.5.

    Returns:
        (length, width), float32; sines in the even columns, cosines in the odd ones.
    """
    frequency = torch.exp(torch.arange(0, width, 2) * (-math.log(10000.0) / width))
    angle = torch.arange(length)[:, None] * frequency
    return torch.stack([angle.sin(), angle.cos()], dim=-1).flatten(1)
