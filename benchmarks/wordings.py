# SPDX-License-Identifier: Apache-2.0
"""Everyday wording in the world: python benchmarks/wordings.py --policy=CHECKPOINT [--objects=clant].

Takes the sentences of `owlxt5_backbones/held_out_sentences*.tsv` that ask for one clear action, and those
that are to be held, and puts objects of the set into them. Each is said in some scenes. A wish is compared
with the same action in CLANT's words in the same scene: was the named object moved rightly? Of what is to
be held, any movement counts against it. Prints rates with Wilson's 95 % intervals, and each failure that
CLANT's words do not have.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, count
from typing import Any, NamedTuple

import numpy as np
import torch
from lerobot.envs.utils import preprocess_observation
from lerobot.policies.factory import make_pre_post_processors
from rich.console import Console
from rich.table import Table
from tqdm import tqdm
from understanding import SENTENCES, Sentence, rate, read_sentences

from lerobot_owlxt5 import OWLxT5Policy
from lerobot_owlxt5.command_line import command
from lerobot_owlxt5.commands.answer import Action, Hold, Request, Target
from lerobot_owlxt5.commands.vocabulary import CUBE_NAMES
from nico_tabletop import TabletopEnv
from nico_tabletop.objects import read_objects
from owlxt5_backbones.grammar import nouns

GERMAN = {
    "can": (("dose", "f"),),
    "mug": (("becher", "m"), ("tasse", "f")),
    "ball": (("ball", "m"),),
    "mustard bottle": (("senfflasche", "f"),),
    "empty wine bottle": (("weinflasche", "f"),),
}
"""German names of CLAEO's objects, each with its gender."""
SLOTS = {
    Target(side="left"): 0,
    Target(side="middle"): 1,
    Target(side="right"): 2,
    Target(order=("second", "left")): 1,
    Target(order=("third", "left")): 2,
    Target(order=("second", "right")): 1,
}

# How often an object is drawn that might fit into a sentence, in German for one by its gender.
_TRIES = 12


@dataclass
class WordingsConfig:
    """What to measure.

    Args:
        policy: Checkpoint of an `owlxt5`: folder or Hub id.
        objects: `clant` or `claeo`.
        scenes: In so many scenes each sentence is said.
        seed: Of the scenes.
        understanding: In place of the checkpoint's: `none`, a folder or a Hub id.
    """

    policy: str
    objects: str = "claeo"
    scenes: int = 4
    seed: int = 0
    understanding: str | None = None


class Said(NamedTuple):
    """A sentence about a scene.

    Attributes:
        sentence: As in the file.
        text: With objects of the scene.
        arrangement: What stands on the left, in the middle and on the right.
        task: What is right to do, in CLANT's words; empty if nothing.
    """

    sentence: Sentence
    text: str
    arrangement: tuple[str, ...]
    task: str


def say(sentence: Sentence, arrangement: tuple[str, ...], rng: np.random.Generator) -> Said | None:
    """Put an object of a scene into a sentence; None if it is about something that the scene has not."""
    chosen = int(rng.integers(3))
    match sentence.answers[0]:
        case Request((Action(verb, target),)) if verb is not None and target != Target():
            marks = Target(side=target.side, order=target.order)
            if marks != Target():
                chosen = SLOTS.get(marks, -1)
            named = Target(target.name, target.colour, side=target.side, order=target.order)
            text = _with_object(sentence, target, arrangement[chosen], rng) if named == target else None
            return (
                Said(sentence, text, arrangement, f"{verb} {arrangement[chosen]}")
                if text and chosen >= 0
                else None
            )
        case Hold():
            return Said(sentence, sentence.text, arrangement, "")
    return None


def _with_object(sentence: Sentence, target: Target, name: str, rng: np.random.Generator) -> str | None:
    """The sentence with another object in place of its target."""
    text = sentence.text
    is_cube = name in CUBE_NAMES
    if sentence.language == "de":
        gender = next((noun.gender for noun in nouns() if noun.german.lower() == target.name), None)
        fitting = [word for word, its in GERMAN.get(name, ()) if its == gender]
        if not fitting or target.colour:
            return None
        return _replaced(text, target.name, str(rng.choice(fitting)))
    if is_cube:  # CLANT: a cube by its colour; marks alone tell cubes apart
        if target.colour:
            text = _replaced(text, target.colour, name) or ""
            return _replaced(text, target.name, "cube") if target.name and text else text or None
        if target.side or target.order:
            return _replaced(text, target.name, "cube") if target.name else text
        return _replaced(text, target.name, f"{name} cube") if target.name else None
    if target.colour or target.side or target.order or not target.name:
        return None
    return _replaced(text, target.name, name)


def _replaced(text: str, old: str, new: str) -> str | None:
    changed, count = re.subn(rf"\b{re.escape(old)}\b", new, text, flags=re.IGNORECASE)
    return changed if count == 1 else None


class World:
    """One environment, and what became of the movements that were tried in it."""

    def __init__(self, config: WordingsConfig) -> None:
        self._policy = OWLxT5Policy.from_pretrained(config.policy)
        if config.understanding:
            self._policy.config.understanding = config.understanding
        self._steps = make_pre_post_processors(self._policy.config, config.policy)
        self._env = TabletopEnv("PUSH-L", objects=config.objects)
        self._seed = config.seed
        self._outcomes: dict[tuple[Any, ...], bool] = {}

    def tell(self, text: str, said: Said) -> tuple[bool, bool, str]:
        """Say something in a scene: did the robot move, rightly, and what did it answer?"""
        preprocess, postprocess = self._steps
        options: dict[str, Any] = {"arrangement": said.arrangement}
        observation, _ = self._env.reset(
            seed=self._seed, options=options | ({"task": said.task} if said.task else {})
        )
        self._policy.reset()
        batch = preprocess(preprocess_observation(observation) | {"task": [text]})
        plan = self._policy.predict_action_chunk(batch)
        moves = bool((plan - plan[:, :1]).abs().max() > 0)
        right = (
            moves
            and bool(said.task)
            and self._carry_out(said, torch.stack([postprocess(a) for a in plan[0]]))
        )
        return moves, right, self._policy.responses[0]

    def _carry_out(self, said: Said, plan: torch.Tensor) -> bool:
        """Whether a plan succeeds; the same plan in the same scene is tried once."""
        key = (said.arrangement, said.task, plan.numpy().tobytes())
        if key not in self._outcomes:
            actions = plan.reshape(len(plan), -1).numpy()
            for step in count():
                *_, done, info = self._env.step(actions[min(step, len(actions) - 1)])
                if done:
                    break
            self._outcomes[key] = bool(info["is_success"])
        return self._outcomes[key]


def _all_said(config: WordingsConfig) -> Iterator[Said]:
    objects = np.array([item.name for item in read_objects(config.objects)])
    rng = np.random.default_rng(config.seed)
    scenes = [tuple(rng.choice(objects, 3, replace=False).tolist()) for _ in range(config.scenes)]
    for sentence in chain.from_iterable(map(read_sentences, SENTENCES)):
        for arrangement in scenes:
            found = (say(sentence, arrangement, rng) for _ in range(_TRIES))
            if said := next(filter(None, found), None):
                yield said


@command("wordings")
def main(config: WordingsConfig) -> None:
    """Say all sentences and print the tables."""
    world, counts = World(config), Counter[tuple[str, str]]()
    for said in tqdm([*_all_said(config)], unit="sentence"):
        moves, right, answer = world.tell(said.text, said)
        group = f"{'wish' if said.task else 'to be held'}, {said.sentence.language}"
        counts[group, "n"] += 1
        counts[group, "moved"] += moves
        counts[group, "right"] += right
        if said.task:
            canonical = world.tell(said.task, said)[1]
            counts[group, "canonical"] += canonical
            if canonical and not right:
                tqdm.write(f"{'wrong' if moves else 'refused'}\t{said.text}\t{said.task}\t{answer}")
        elif moves:
            tqdm.write(f"carried out\t{said.text}\t{answer}")
    table = Table(title=f"{config.objects}, {config.scenes} scenes a sentence; Wilson's 95 % intervals")
    for heading in ("said", "n", "moved rightly", "the same in CLANT's words", "moved"):
        table.add_column(heading, justify="left" if heading == "said" else "right")
    for group in dict.fromkeys(group for group, _ in counts):
        n = counts[group, "n"]
        wish = group.startswith("wish")
        shown = [rate(counts[group, key], n, 1) if wish else "" for key in ("right", "canonical")]
        table.add_row(group, str(n), *shown, rate(counts[group, "moved"], n, 1))
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
