# SPDX-License-Identifier: Apache-2.0
"""Whether a thing is known again that was shown once: python benchmarks/teaching.py [--among=known].

Each try points at a thing in one freely placed scene, gives it a name, and asks for it in two other scenes.
In one the thing is there, in the other it is not. The things are those of `household` that the embedded
detector never saw in training. With `--among=known` they are those that it may know: on these the limit of
likeness was chosen. In the end all have been taught at once, and CLAEO is asked for by names.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from tqdm import tqdm
from understanding import rate

from lerobot_owlxt5.backbones.taught import TaughtThings
from lerobot_owlxt5.backbones.zero_shot import ZeroShotDetector
from lerobot_owlxt5.command_line import check_numbers, command
from lerobot_owlxt5.commands.answer import Target
from lerobot_owlxt5.scene import Scene, Search, Thing
from nico_tabletop.objects import read_objects
from nico_tabletop.placement import draw_poses
from nico_tabletop.robot import EYES
from nico_tabletop.simulation import TabletopSimulation
from owlxt5_backbones.catalogue import HELD_OUT
from owlxt5_backbones.evaluate_detector import CAMERA, CLOSE, distance_on_table

SIZE = (240, 320)


@dataclass
class TeachingConfig:
    """Teach a detector things, and ask for them again."""

    # Which things of `household`: held_out (of no category in training) or known.
    among: str = "held_out"
    # Tries for each thing.
    tries: int = 24
    # An OWLv2 or OWL-ViT: a folder, a Hub id, or embedded.
    detector: str = "embedded"
    # Of the scenes.
    seed: int = 0


class Eyes:
    """A world, and a detector that looks at it."""

    def __init__(self, suite: str, detector: ZeroShotDetector) -> None:
        self.names = [item.name for item in read_objects(suite)]
        self._simulation, self._detector = TabletopSimulation(read_objects(suite)), detector

    def look(self, arrangement: list[str], random: np.random.Generator) -> Scene:
        """Lay the table with three things, anywhere, and look at it."""
        self._simulation.reset(tuple(arrangement), draw_poses(random))
        image = torch.from_numpy(self._simulation.render(EYES, *SIZE).copy()).permute(2, 0, 1)[None]
        return Scene(self._detector, {CAMERA: image}, [], lambda name: name)

    def point_at(self, name: str, random: np.random.Generator) -> tuple[float, float]:
        """Somewhere in the middle half of an object's box, as a finger or a mouse would."""
        left, upper, right, lower = self._box(name)
        aside, down = random.uniform(0.25, 0.75, 2)
        return float(left + aside * (right - left)), float(upper + down * (lower - upper))

    def distance(self, thing: Thing, name: str) -> float:
        """How far a thing that was seen is from where an object stands, metres."""
        seen, true = ((box[:2] + box[2:]) / 2 for box in (thing.box.numpy(), self._box(name)))
        return distance_on_table(self._simulation, seen, true, SIZE)

    def _box(self, name: str) -> NDArray[np.float64]:
        """Of an object that is there, from the simulator."""
        boxes: NDArray[np.float64] = self._simulation.object_boxes(SIZE[1] / SIZE[0])
        return boxes[self._simulation.arrangement.index(name)]


def others(names: list[str], name: str, count: int, random: np.random.Generator) -> list[str]:
    """So many other things."""
    return [
        str(other) for other in random.choice([each for each in names if each != name], count, replace=False)
    ]


def attempt(
    eyes: Eyes, detector: ZeroShotDetector, name: str, random: np.random.Generator
) -> tuple[bool, bool, bool]:
    """Teach a thing from one look.

    Returns:
        Whether it is found where it is; whether it is listed there; and whether it is not found in a scene
        without it.
    """
    detector.taught = TaughtThings("benchmark")
    scene = eyes.look([name, *others(eyes.names, name, 2, random)], random)
    shown = scene.at(*eyes.point_at(name, random))
    if shown is None:
        return False, False, True
    scene.teach(shown, name)
    asked = Search(Target(name), takes_best=True)
    scene = eyes.look([name, *others(eyes.names, name, 2, random)], random)
    found = scene.find(asked).thing
    right = found is not None and eyes.distance(found, name) <= CLOSE
    listed = any(thing.name == name and eyes.distance(thing, name) <= CLOSE for thing in scene.things)
    return right, listed, eyes.look(others(eyes.names, name, 3, random), random).find(asked).thing is None


def by_name(eyes: Eyes, tries: int, random: np.random.Generator) -> list[bool]:
    """Whether objects are found by their names, whatever was taught."""
    found = []
    for _ in range(tries):
        arrangement = others(eyes.names, "", 3, random)
        scene = eyes.look(arrangement, random)
        for name in arrangement:
            thing = scene.find(Search(Target(name), takes_best=True)).thing
            found.append(thing is not None and eyes.distance(thing, name) <= CLOSE)
    return found


@command("teaching")
def main(config: TeachingConfig) -> None:
    """Teach, ask, and print the table."""
    check_numbers(config, "tries")
    if config.among not in ("held_out", "known"):
        raise ValueError(f"--among is held_out or known, not {config.among!r}")
    torch.set_num_threads(1)
    detector = ZeroShotDetector(config.detector, None, None, CAMERA)
    eyes, claeo = Eyes("household", detector), Eyes("claeo", detector)
    names = [name for name in eyes.names if (name in HELD_OUT) == (config.among == "held_out")]
    table = Table(title=f"Taught by one look, {config.detector}, {config.among}; Wilson's 95 % intervals, %")
    for heading in ("thing", "tries", "found within 2 cm", "listed by its name", "absent: not found"):
        table.add_column(heading, justify="left" if heading == "thing" else "right")
    everything: list[tuple[bool, bool, bool]] = []
    learnt = TaughtThings("benchmark")
    with tqdm(total=len(names) * config.tries, unit="try") as bar:
        for name in names:
            random = np.random.default_rng((config.seed, eyes.names.index(name)))
            tried = []
            for _ in range(config.tries):
                tried.append(attempt(eyes, detector, name, random))
                bar.update()
            if detector.taught:
                learnt.add(name, detector.taught[name][0])
            everything += tried
            table.add_row(name, str(len(tried)), *_rates(tried))
    table.add_row("all", str(len(everything)), *_rates(everything), style="bold")
    console = Console(highlight=False)
    console.print(table)
    for about, taught in (("nothing", TaughtThings("benchmark")), (f"all {len(learnt)} things", learnt)):
        detector.taught = taught
        found = by_name(claeo, config.tries, np.random.default_rng(config.seed))
        console.print(
            f"CLAEO by name, {about} taught: {rate(sum(found), len(found), 1)} of {len(found)} found"
        )


def _rates(tried: list[tuple[bool, bool, bool]]) -> list[str]:
    return [rate(sum(column), len(column), 1) for column in zip(*tried, strict=True)]


if __name__ == "__main__":
    main()
