# SPDX-License-Identifier: Apache-2.0
"""Do words find things? python benchmarks/references.py [--scenes=60].

Asks a detector for things in rendered scenes of CLANT and CLAEO, on the slots and placed freely, as a policy
does once it has understood a sentence: by each object's name and synonyms, present or absent; by a name that
fits several; by sides and neighbours; by a colour that is none. MuJoCo's boxes say what is right. Prints the
rates with Wilson's 95 % intervals.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from rich.console import Console
from rich.table import Table
from torch import Tensor
from torchvision.ops import box_iou
from tqdm import trange
from understanding import rate

from lerobot_owlxt5.backbones.pretrained import EMBEDDED
from lerobot_owlxt5.backbones.zero_shot import ZeroShotDetector
from lerobot_owlxt5.command_line import command
from lerobot_owlxt5.commands.answer import Landmark, Relation, Target
from lerobot_owlxt5.commands.instruction import target_of
from lerobot_owlxt5.scene import Scene, Search
from nico_tabletop.objects import read_objects
from nico_tabletop.placement import find_placement
from nico_tabletop.robot import EYES
from nico_tabletop.simulation import TabletopSimulation
from owlxt5_backbones.evaluate_detector import CAMERA

SIZE = (240, 320)
OVERLAP = 0.5
"""A box that shares so much of its area with the true one is of this thing."""


@dataclass
class ReferencesConfig:
    """What to measure.

    Args:
        detector: `embedded`, or the folder or Hub id of another.
        scenes: Scenes for each set of objects and placement.
        seed: Of the scenes.
    """

    detector: str = EMBEDDED
    scenes: int = 60
    seed: int = 3


def _questions(
    arrangement: Sequence[str], names: Mapping[str, str], left_to_right: Sequence[int]
) -> Iterator[tuple[str, Target, int | None]]:
    """What is asked in a scene: its kind, the target, and which object is right; None where none is."""
    for name, meant in names.items():
        index = arrangement.index(meant) if meant in arrangement else None
        yield "absent" if index is None else "present", target_of(name), index
    for side, index in zip(("left", "middle", "right"), left_to_right, strict=True):
        yield "side, no name", Target(side=side), index
    if all(target_of(name).name == "cube" for name in arrangement):
        yield "several fit", Target("cube"), None
        yield "no such colour", Target("cube", "blurple"), None
        for side, index in zip(("left", "middle", "right"), left_to_right, strict=True):
            yield "side, several fit", Target("cube", side=side), index
        middle = target_of(arrangement[left_to_right[1]])
        for kind, index in (("left of", left_to_right[0]), ("right of", left_to_right[2])):
            yield (
                "neighbour",
                Target("cube", relation=Relation(kind, (Landmark(middle.name, middle.colour),))),
                index,
            )


def _which(box: Tensor | None, truth: Tensor) -> int | None:
    """Which of the true boxes a box is; None for no box, -1 for none of them."""
    if box is None:
        return None
    overlap = box_iou(box[None], truth)[0]
    return int(overlap.argmax()) if overlap.max() >= OVERLAP else -1


@command("references")
def main(config: ReferencesConfig) -> None:
    """Ask and print the table."""
    detector = ZeroShotDetector(config.detector, None, None, CAMERA)
    table = Table(title="What was asked for, and found or rightly not found; Wilson's 95 % intervals")
    for heading in ("objects", "asked", "n", "right", "a wrong thing"):
        table.add_column(heading, justify="left" if heading in ("objects", "asked") else "right")
    for suite in ("clant", "claeo"):
        objects = tuple(read_objects(suite))
        names = {name: item.name for item in objects for name in (item.name, *item.synonyms)}
        simulation = TabletopSimulation(objects)
        for placement in ("slots", "free"):
            rng, counts = np.random.default_rng(config.seed), Counter[tuple[str, str]]()
            for _ in trange(config.scenes, desc=f"{suite}, {placement}", unit="scene"):
                arrangement = rng.choice(np.array([item.name for item in objects]), 3, replace=False).tolist()
                simulation.reset(tuple(arrangement), find_placement(placement)(rng))
                image = torch.from_numpy(simulation.render(EYES, *SIZE).copy()).permute(2, 0, 1)[None]
                truth = torch.as_tensor(simulation.object_boxes(SIZE[1] / SIZE[0]), dtype=torch.float32)
                observation: dict[str, Any] = {CAMERA: image}
                scene = Scene(detector, observation, [item.name for item in objects], lambda name: name)
                order = (truth[:, 0] + truth[:, 2]).argsort().tolist()
                for kind, target, right in _questions(arrangement, names, order):
                    thing = scene.find(Search(target)).thing
                    given = _which(thing.box if thing else None, truth)
                    counts[kind, "n"] += 1
                    counts[kind, "right"] += given == right
                    counts[kind, "wrong"] += given is not None and given != right
            for kind in dict.fromkeys(kind for kind, _ in counts):
                n = counts[kind, "n"]
                rates = [rate(counts[kind, key], n, 1) for key in ("right", "wrong")]
                table.add_row(f"{suite}, {placement}", kind, str(n), *rates)
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
