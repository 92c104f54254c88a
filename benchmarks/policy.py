# SPDX-License-Identifier: Apache-2.0
"""Speed of the policy: python benchmarks/policy.py --dataset_root=data/clant [--device=cuda].

Paper's sizes, batches of 64 in the default mix of modes, a T5-small with random weights and 32,128 tokens, no
detector (ground truth). Data loading is excluded: the batches lie in memory. Prints the seconds of a training
step (forward, backward, Adam) in float32 and under bfloat16 autocast, with the share of the speed at which
the same machine multiplies matrices, the milliseconds of the first and of every later `select_action`, and
how long OWLv2-base and the embedded detector take for an image.
"""

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from lerobot.datasets import LeRobotDataset, LeRobotDatasetMetadata
from lerobot.datasets.factory import resolve_delta_timestamps
from lerobot.policies.factory import make_policy, make_pre_post_processors
from lerobot.utils.collate import lerobot_collate_fn
from rich.console import Console
from rich.table import Table
from torch import Tensor
from torch.utils.data import DataLoader, Subset
from torch.utils.flop_counter import FlopCounterMode
from transformers import AutoModelForSeq2SeqLM, Owlv2Config, Owlv2ForObjectDetection

from lerobot_owlxt5.backbones.pretrained import EMBEDDED
from lerobot_owlxt5.backbones.small_t5 import SmallT5Config, collect_texts, make_small_t5
from lerobot_owlxt5.backbones.zero_shot import ZeroShotDetector
from lerobot_owlxt5.command_line import command
from lerobot_owlxt5.configuration_owlxt5 import OWLxT5Config

PRECISIONS = {"float32": torch.float32, "bfloat16": torch.bfloat16}
BATCHES, BATCH_SIZE = 8, 64
VOCABULARY = 32128


@dataclass
class PolicySpeedConfig:
    """What to measure with.

    Args:
        dataset_root: Folder of CLANT as a LeRobotDataset.
        device: `cpu` or `cuda`.
    """

    dataset_root: Path
    device: str = "cpu"


def _t5_small(folder: Path, root: Path) -> Path:
    sizes = {"d_model": 512, "d_kv": 64, "d_ff": 2048, "num_layers": 6, "num_heads": 8}
    make_small_t5(SmallT5Config(folder, root, vocab_size=VOCABULARY, **sizes), collect_texts(root))
    model = AutoModelForSeq2SeqLM.from_pretrained(folder)
    model.resize_token_embeddings(VOCABULARY)
    model.save_pretrained(folder)
    return folder


def _batches(root: Path, config: OWLxT5Config, preprocessor: Any) -> list[dict[str, Any]]:
    """Random frames, as the data loader of lerobot-train gives them."""
    meta = LeRobotDatasetMetadata("local/speed", root=root)
    windows = resolve_delta_timestamps(config, meta)
    dataset = LeRobotDataset("local/speed", root=root, delta_timestamps=windows, video_backend="pyav")
    generator = torch.Generator().manual_seed(0)
    chosen = torch.randint(len(dataset), (BATCHES * BATCH_SIZE,), generator=generator).tolist()
    loader = DataLoader(Subset(dataset, chosen), BATCH_SIZE, collate_fn=lerobot_collate_fn)
    return [preprocessor(batch) for batch in loader]


def _seconds(work: Callable[[], object], device: str, repeats: int) -> float:
    if device == "cuda":
        torch.cuda.synchronize()
    began = time.perf_counter()
    for _ in range(repeats):
        work()
    if device == "cuda":
        torch.cuda.synchronize()
    return (time.perf_counter() - began) / repeats


def _matrix_speed(device: str, dtype: torch.dtype) -> float:
    """Floating point operations a second of a large matrix product."""
    a, b = (torch.randn(2048, 2048, device=device, dtype=dtype) for _ in range(2))
    a @ b
    return 2 * 2048**3 / _seconds(lambda: a @ b, device, 20)


def _lstm_operations(module: torch.nn.LSTM, inputs: tuple[Tensor, ...], count: list[float]) -> None:
    """Forward operations of a call, which PyTorch's counter leaves out."""
    weights = sum(weight.numel() for name, weight in module.named_parameters() if name.startswith("weight"))
    rows = inputs[0].numel() // inputs[0].shape[-1]
    count[0] += 2 * weights * rows


@command("policy")
def main(config: PolicySpeedConfig) -> None:
    """Measure and print."""
    root, device = config.dataset_root, config.device
    console = Console()
    with tempfile.TemporaryDirectory() as folder:
        t5 = _t5_small(Path(folder), root)
        policy_config = OWLxT5Config(language_model=str(t5), detector="ground_truth", device=device)
        meta = LeRobotDatasetMetadata("local/speed", root=root)
        policy = make_policy(policy_config, ds_meta=meta)
    preprocessor, _ = make_pre_post_processors(policy_config, dataset_stats=meta.stats)
    batches = _batches(root, policy_config, preprocessor)
    optimizer = torch.optim.Adam(policy.get_optim_params(), lr=1e-5)

    def train(dtype: torch.dtype) -> None:
        policy.training_seed.zero_()  # the same modes and prompts each time, which T5 has encoded by then
        for batch in batches:
            with torch.autocast(device, dtype, enabled=dtype is not torch.float32):
                loss, _ = policy.forward(batch)
            loss.backward()
            optimizer.step()
            optimizer.zero_grad()

    policy.train()
    train(torch.float32)  # encodes each prompt once
    recurrent = [0.0]
    hooks = [
        module.register_forward_hook(lambda module, inputs, _: _lstm_operations(module, inputs, recurrent))
        for module in policy.modules()
        if isinstance(module, torch.nn.LSTM)
    ]
    with FlopCounterMode(display=False) as counter:
        train(torch.float32)
    for hook in hooks:
        hook.remove()
    operations = (counter.get_total_flops() + 3 * recurrent[0]) / BATCHES

    threads = torch.get_num_threads()
    table = Table(title=f"A training step of {BATCH_SIZE} on {device}, {threads} threads")
    for heading in ("precision", "s", "GFLOP", "GFLOP/s", "of a matrix product's"):
        table.add_column(heading, justify="right")
    for name, dtype in PRECISIONS.items():
        train(dtype)
        seconds = min(_seconds(lambda dtype=dtype: train(dtype), device, 1) for _ in range(3)) / BATCHES
        speed = operations / seconds
        share = f"{100 * speed / _matrix_speed(device, dtype):.0f} %"
        table.add_row(name, f"{seconds:.3f}", f"{operations / 1e9:.0f}", f"{speed / 1e9:.0f}", share)
    console.print(table)

    one = {key: value[:1] for key, value in batches[0].items() if key.startswith("observation.")}
    one["task"] = batches[0]["task"][:1]
    policy.reset()
    policy.select_action(one)
    policy.reset()
    first = _seconds(lambda: policy.select_action(one), device, 1)
    later = _seconds(lambda: policy.select_action(one), device, 50)
    console.print(f"select_action: first {1000 * first:.1f} ms, later {1000 * later:.3f} ms")

    # The base model, which looks at 960 pixels in patches of 16; random weights.
    model = Owlv2ForObjectDetection(Owlv2Config(vision_config={"image_size": 960})).to(device).eval()
    image = torch.rand(1, 3, 960, 960, device=device)
    query = torch.ones(1, 16, dtype=torch.long, device=device)

    @torch.no_grad()
    def detect(dtype: torch.dtype) -> None:
        with torch.autocast(device, dtype, enabled=dtype is not torch.float32):
            model(pixel_values=image, input_ids=query, attention_mask=query)

    for name, dtype in PRECISIONS.items():
        detect(dtype)
        seconds = _seconds(lambda dtype=dtype: detect(dtype), device, 3)
        console.print(f"OWLv2-base, forward, {name}: {seconds:.2f} s an image")

    embedded = ZeroShotDetector(EMBEDDED, None, None, "image")
    view = {"image": torch.rand(1, 3, 240, 320, device=device)}
    embedded(view, [["mug"]])
    seconds = _seconds(lambda: embedded(view, [["mug"]]), device, 20)
    console.print(f"embedded detector, from image and name to box: {1000 * seconds:.0f} ms an image")


if __name__ == "__main__":
    main()
