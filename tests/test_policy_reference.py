# SPDX-License-Identifier: Apache-2.0
"""The core beside a reference in plain matrix products: a parameter count cannot see what a network computes.

The reference follows the paper's section 3 and the CrossT5 authors' published code, in NumPy and float64.
"""

from typing import Any

import numpy as np
import pytest
import torch

from lerobot_owlxt5.model.core import CrossmodalCore

Array = np.ndarray[Any, np.dtype[np.float64]]
Weights = dict[str, Array]

TOKENS, STEPS, N_JOINTS, DIM_LANGUAGE, DIM_MODEL, N_HEADS, DIM_LSTM = 5, 7, 3, 12, 16, 4, 6


def linear(w: Weights, name: str, x: Array) -> Array:
    return x @ w[f"{name}.weight"].T + w[f"{name}.bias"]


def layer_norm(w: Weights, name: str, x: Array) -> Array:
    centred = x - x.mean(axis=-1, keepdims=True)
    scaled = centred / np.sqrt((centred**2).mean(axis=-1, keepdims=True) + 1e-5)
    return scaled * w[f"{name}.weight"] + w[f"{name}.bias"]


def sigmoid(x: Array) -> Array:
    return 1 / (1 + np.exp(-x))


def lstm_cell(w: Weights, suffix: str, x: Array, h: Array, c: Array) -> tuple[Array, Array]:
    """One step of an LSTM with the weights w["weight_ih" + suffix] and so on: input, forget, cell, output."""
    gates = w["weight_ih" + suffix] @ x + w["bias_ih" + suffix] + w["weight_hh" + suffix] @ h
    i, f, g, o = np.split(gates + w["bias_hh" + suffix], 4)
    c = sigmoid(f) * c + sigmoid(i) * np.tanh(g)
    return sigmoid(o) * np.tanh(c), c


def encode_action(w: Weights, visual: Array, joints: Array) -> Array:
    """Two layers, each forwards and backwards over [visual ; joints]: (steps, 2 * dim_lstm)."""
    lstm = {key.removeprefix("encoder.lstm."): value for key, value in w.items()}
    layer = np.concatenate([np.broadcast_to(visual, (len(joints), visual.shape[-1])), joints], axis=1)
    for number in range(2):
        directions = []
        for suffix, order in ((f"_l{number}", 1), (f"_l{number}_reverse", -1)):
            h = c = np.zeros(DIM_LSTM)
            outputs = []
            for x in layer[::order]:
                h, c = lstm_cell(lstm, suffix, x, h, c)
                outputs.append(h)
            directions.append(np.stack(outputs)[::order])
        layer = np.concatenate(directions, axis=1)
    return layer


def positions(length: int, width: int) -> Array:
    table = np.zeros((length, width))
    for p in range(length):
        for i in range(width // 2):
            table[p, 2 * i] = np.sin(p / 10000 ** (2 * i / width))
            table[p, 2 * i + 1] = np.cos(p / 10000 ** (2 * i / width))
    return table


def crossmodal(w: Weights, language: Array, action: Array) -> Array:
    """h (tokens, dim_model): both sides go through linear, ReLU and one and the same layer norm."""
    w = {key.removeprefix("crossmodal."): value for key, value in w.items()}
    queries = layer_norm(w, "norm_inputs", np.maximum(linear(w, "queries", language), 0))
    queries = queries + positions(*queries.shape)
    keys = layer_norm(w, "norm_inputs", np.maximum(linear(w, "keys", action), 0))
    projections = zip(
        (queries, keys, keys),
        np.split(w["attention.in_proj_weight"], 3),
        np.split(w["attention.in_proj_bias"], 3),
        strict=True,
    )
    q, k, v = (np.split(x @ weight.T + bias, N_HEADS, axis=1) for x, weight, bias in projections)
    heads = []
    for head in range(N_HEADS):
        similarity = q[head] @ k[head].T / np.sqrt(DIM_MODEL / N_HEADS)
        attention = np.exp(similarity) / np.exp(similarity).sum(axis=1, keepdims=True)
        heads.append(attention @ v[head])
    z = queries + linear(w, "attention.out_proj", np.concatenate(heads, axis=1))
    z = layer_norm(w, "norm_attention", z)
    inner = np.maximum(linear(w, "feedforward.0", z), 0)
    return layer_norm(w, "norm_feedforward", z + linear(w, "feedforward.3", inner))


def first_state(w: Weights, h: Array) -> Array:
    """The decoder's first hidden state and memory (2, layers, dim_lstm), of the mean of h over the tokens."""
    return linear(w, "decoder.initial", h.mean(axis=0)).reshape(2, 2, DIM_LSTM)


def decode(w: Weights, h: Array, visual: Array, pose: Array, steps: int) -> Array:
    hidden, memory = ([*layers] for layers in first_state(w, h))
    outputs = []
    for step in range(steps):
        x = np.concatenate([visual[min(step, len(visual) - 1)], pose])
        for layer in range(2):
            cell = {key.removeprefix(f"decoder.cells.{layer}."): value for key, value in w.items()}
            hidden[layer], memory[layer] = lstm_cell(cell, "", x, hidden[layer], memory[layer])
            x = hidden[layer]
        pose = np.tanh(linear(w, "decoder.joints", x))
        outputs.append(pose)
    return np.stack(outputs)


@pytest.mark.parametrize("frames", [1, STEPS])
@pytest.mark.parametrize("dim_visual", [2, 30])
def test_the_core_computes_what_the_reference_computes(dim_visual: int, frames: int) -> None:
    torch.manual_seed(0)
    core = CrossmodalCore(
        DIM_LANGUAGE,
        dim_visual,
        N_JOINTS,
        dim_model=DIM_MODEL,
        n_heads=N_HEADS,
        dim_feedforward=20,
        dim_lstm=DIM_LSTM,
    ).eval()
    # Norms and biases begin as ones and zeros, which would hide that two of them are swapped.
    with torch.no_grad():
        for parameter in core.parameters():
            parameter.add_(0.3 * torch.randn_like(parameter))
    w = {name: parameter.detach().double().numpy() for name, parameter in core.named_parameters()}
    language, visual = torch.randn(1, TOKENS, DIM_LANGUAGE), torch.randn(1, frames, dim_visual)
    joints = 2 * torch.rand(1, STEPS, N_JOINTS) - 1
    with torch.no_grad():
        h = core.crossmodal(language, core.encoder(visual, joints))[0]
        output = core(language, torch.ones(1, TOKENS, dtype=torch.bool), visual, joints)
        state = core.decoder.initial(output.context)[0]
        moved = core.decoder(output.context, visual, joints[:, 0], STEPS)[0][0]

    words, seen, moves = (tensor[0].double().numpy() for tensor in (language, visual, joints))
    expected_h = crossmodal(w, words, encode_action(w, seen, moves))
    for name, ours, expected in (
        ("h", h, expected_h),
        ("FC(h)", output.language_residual[0], linear(w, "fc", expected_h)),
        ("first state", state, first_state(w, expected_h).reshape(-1)),
        ("joints", moved, decode(w, expected_h, seen, moves[0], STEPS)),
    ):
        assert np.abs(ours.numpy() - expected).max() < 1e-5, name


def test_the_first_weights_of_attention_are_xavier_normal() -> None:
    torch.manual_seed(0)
    attention = CrossmodalCore(512, 2, 10).crossmodal.attention
    assert attention.in_proj_weight is not None
    for weight in (*attention.in_proj_weight.chunk(3), attention.out_proj.weight):
        assert weight.std().item() == pytest.approx(512**-0.5, rel=0.02)
