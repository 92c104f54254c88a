# SPDX-License-Identifier: Apache-2.0
"""The action path: an LSTM that encodes a joint sequence and one that generates it (paper, section 3)."""

import torch
from torch import Tensor, nn

FORGET_GATE_BIAS = 2.0
"""Initial bias of the action decoder's forget gates: they pass 88 percent (our decision)."""


class ActionEncoder(nn.Module):
    """Bidirectional LSTM over [visual ; joints] at each step.

    All sequences have the same length (a pose is held after an episode's end), so nothing has to be packed:
    with PyTorch's CPU kernels that is four times as fast.
    """

    def __init__(self, dim_visual: int, n_joints: int, dim_lstm: int, n_layers: int) -> None:
        super().__init__()
        self.lstm = nn.LSTM(dim_visual + n_joints, dim_lstm, n_layers, batch_first=True, bidirectional=True)
        self.dim_output = 2 * dim_lstm

    def forward(self, visual: Tensor, joints: Tensor) -> Tensor:
        """Encode.

        Args:
            visual: (batch, steps, dim_visual), or one step of what stays the same.
            joints: (batch, steps, n_joints), scaled to [-1, 1].

        Returns:
            (batch, steps, 2 * dim_lstm).
        """
        inputs = torch.cat([visual.expand(-1, joints.shape[1], -1), joints], dim=-1)
        # In full precision under autocast too: not every processor has an LSTM in bf16.
        with torch.autocast(inputs.device.type, enabled=False):
            return self.lstm(inputs.float())[0]


class ActionDecoder(nn.Module):
    """LSTM that generates joint positions from [visual ; its own last output], beginning with the first pose.

    It runs free in training as it does on the robot: its own outputs, never the targets, are fed back.
    The stop output beside the joints is our addition; the paper does not say how a movement ends.
    """

    def __init__(
        self, dim_context: int, dim_visual: int, n_joints: int, dim_lstm: int, n_layers: int
    ) -> None:
        super().__init__()
        self.shape = (n_layers, dim_lstm)
        self.initial = nn.Linear(dim_context, 2 * n_layers * dim_lstm)
        # For a single step PyTorch's whole-sequence LSTM takes up to 1.7 times as long on a CPU.
        cells = [nn.LSTMCell(dim_visual + n_joints, dim_lstm)]
        cells += [nn.LSTMCell(dim_lstm, dim_lstm) for _ in range(n_layers - 1)]
        # What to do is told once, in the initial state. An open forget gate lets it reach the late steps;
        # PyTorch's gate, half open, halves it at each step and makes learning several times slower.
        for cell in cells:
            nn.init.constant_(cell.bias_ih[dim_lstm : 2 * dim_lstm], FORGET_GATE_BIAS)
        self.cells = nn.ModuleList(cells)
        self.joints = nn.Linear(dim_lstm, n_joints)
        self.stop = nn.Linear(dim_lstm, 1)

    def forward(self, context: Tensor, visual: Tensor, pose: Tensor, steps: int) -> tuple[Tensor, Tensor]:
        """Generate a movement.

        Args:
            context: (batch, dim_context), from which the LSTM's initial state is made.
            visual: (batch, steps, dim_visual), or one step of what stays the same.
            pose: (batch, n_joints), the first pose, scaled to [-1, 1].
            steps: Number of steps to generate.

        Returns:
            Joint targets (batch, steps, n_joints) in [-1, 1], and stop logits (batch, steps).
        """
        state = self.initial(context).unflatten(1, (2, *self.shape)).unbind(dim=1)
        hidden, memory = ([*layers.unbind(dim=1)] for layers in state)
        outputs, tops = [], []
        for seen in visual.expand(-1, steps, -1).unbind(dim=1):
            signal = torch.cat([seen, pose], dim=-1)
            for layer, cell in enumerate(self.cells):
                hidden[layer], memory[layer] = cell(signal, (hidden[layer], memory[layer]))
                signal = hidden[layer]
            # Under autocast too joints keep their precision: bf16 has steps of half a degree at 100 degrees.
            pose = torch.tanh(self.joints(signal).to(pose))
            outputs.append(pose)
            tops.append(signal)
        return torch.stack(outputs, dim=1), self.stop(torch.stack(tops, dim=1)).squeeze(-1)


def hold_after_stop(actions: Tensor, stop_logits: Tensor) -> Tensor:
    """Repeat the action at which the stop output first exceeds one half.

    Args:
        actions: (batch, steps, joints).
        stop_logits: (batch, steps).

    Returns:
        (batch, steps, joints).
    """
    steps = torch.arange(actions.shape[1], device=actions.device)
    stopped = stop_logits > 0
    last = torch.where(stopped.any(dim=1), stopped.int().argmax(dim=1), actions.shape[1] - 1)
    index = torch.minimum(steps, last[:, None])
    return actions.gather(1, index[..., None].expand_as(actions))
