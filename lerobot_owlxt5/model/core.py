# SPDX-License-Identifier: Apache-2.0
"""The trained core of the policy: everything between the split language model and the joints."""

from typing import NamedTuple

from torch import Tensor, nn

from .action import ActionDecoder, ActionEncoder
from .transformer import CrossmodalTransformer


class CoreOutput(NamedTuple):
    """What language and action have become together.

    Attributes:
        language_residual: FC(h), (batch, tokens, dim_language): what is added to `l_enc` before T5's decoder.
        context: Mean of h over the tokens, (batch, dim_model): what the action decoder begins with.
    """

    language_residual: Tensor
    context: Tensor


class CrossmodalCore(nn.Module):
    """Action encoder, crossmodal Transformer and action decoder (paper, figure 2).

        a_enc   = LSTM([visual ; joints])
        h       = Transformer(queries = l_enc, keys and values = a_enc)
        l_out   = T5 decoder(l_enc + FC(h))
        a_out   = LSTM decoder(mean of h over the tokens, visual, first pose)

    With the paper's sizes it has 6,352,394 parameters, and the stop output 257 more.
    """

    def __init__(
        self,
        dim_language: int,
        dim_visual: int,
        n_joints: int,
        *,
        dim_model: int = 512,
        n_heads: int = 4,
        dim_feedforward: int = 1024,
        dropout: float = 0.25,
        dim_lstm: int = 256,
        n_lstm_layers: int = 2,
    ) -> None:
        super().__init__()
        self.encoder = ActionEncoder(dim_visual, n_joints, dim_lstm, n_lstm_layers)
        self.crossmodal = CrossmodalTransformer(
            dim_language, self.encoder.dim_output, dim_model, n_heads, dim_feedforward, dropout
        )
        self.fc = nn.Linear(dim_model, dim_language)
        self.decoder = ActionDecoder(dim_model, dim_visual, n_joints, dim_lstm, n_lstm_layers)
        """Movement out of a `CoreOutput`'s context."""

    def forward(self, language: Tensor, language_mask: Tensor, visual: Tensor, joints: Tensor) -> CoreOutput:
        """Join language with visual features and joints.

        Args:
            language: l_enc, (batch, tokens, dim_language).
            language_mask: (batch, tokens) bool, False on padding.
            visual: (batch, steps, dim_visual), or one step of what stays the same.
            joints: (batch, steps, n_joints), scaled to [-1, 1].
        """
        h = self.crossmodal(language, self.encoder(visual, joints))
        weight = language_mask.to(h).unsqueeze(-1)
        return CoreOutput(self.fc(h), (h * weight).sum(dim=1) / weight.sum(dim=1))
