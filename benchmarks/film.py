# SPDX-License-Identifier: Apache-2.0
"""Films a trained owlxt5 at six commands.

    python benchmarks/film.py --checkpoint=outputs/owlxt5/checkpoints/last/pretrained_model --image=film.webp

Each panel is what NICO sees of an everyday object. The circle is where its detector found the named object
before it moved, with the score; the last line is what it says of its movement afterwards, from two images
and its own joints alone.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lerobot.configs import PreTrainedConfig
from lerobot.policies import make_pre_post_processors
from PIL import Image, ImageDraw, ImageFont
from rollout import as_batch
from torch import Tensor

from lerobot_owlxt5 import finished_episode
from lerobot_owlxt5.command_line import command
from lerobot_owlxt5.modeling_owlxt5 import OWLxT5Policy
from nico_tabletop.env import TabletopEnv
from nico_tabletop.objects import read_objects
from nico_tabletop.robot import EYES

SHOTS = (
    ("PUSH-L", ("mustard bottle", "ball", "mug")),
    ("PULL-M", ("can", "mug", "empty wine bottle")),
    ("SLIDE-R-L", ("ball", "white chess piece", "can")),
    ("PUSH-M", ("mug", "empty wine bottle", "mustard bottle")),
    ("PULL-L", ("ball", "can", "white chess piece")),
    ("SLIDE-L-R", ("white chess piece", "mustard bottle", "ball")),
)
"""Action and arrangement; six objects, each acted on once."""
COLUMNS, WIDTH, HEIGHT, LINE = 3, 256, 192, 18
EVERY, REST = 2, 16  # steps of a frame, and frames at the end


@dataclass
class FilmConfig:
    """What to film.

    Args:
        checkpoint: Folder of a trained owlxt5, its `pretrained_model`.
        image: Animated WebP to write, which keeps the colours as the robot sees them.
        policy_options: Of the policy, in place of the checkpoint's own, such as `[--detector=embedded]`.
    """

    checkpoint: Path
    image: Path
    policy_options: list[str] = field(default_factory=list)


class Shot:
    """One rollout, the command, where the object was found, and what the policy says afterwards."""

    def __init__(
        self, policy: OWLxT5Policy, processors: Any, action: str, arrangement: tuple[str, ...]
    ) -> None:
        before, after = processors
        env = TabletopEnv(action, "claeo")
        observation, _ = env.reset(seed=0, options={"arrangement": arrangement})
        self.command = env.task_description
        first = as_batch(observation, self.command)
        name = self.command.split(" ", 1)[1]
        detector = policy.visual.detector
        found = detector(before(dict(first)), [[name]])
        self.centre, self.score = found.centre[0, 0].tolist(), float(found.score[0, 0])
        self.found = self.score >= detector.threshold
        policy.reset()
        self.frames, actions = [observation["pixels"][EYES]], list[Tensor]()
        done = False
        while not done:
            actions.append(after(policy.select_action(before(as_batch(observation, self.command)))))
            observation, _, _, done, info = env.step(actions[-1][0].numpy())
            self.frames.append(observation["pixels"][EYES])
        self.outcome = info["outcome"]
        last, movement = as_batch(observation, self.command), actions[: max(1, policy.movement_steps[0])]
        episode = finished_episode([first, last], movement, policy.config.max_episode_steps)
        labels = [item.name for item in read_objects("claeo")]
        [self.says] = policy.describe(before(episode), labels=labels)
        env.close()


def _panel(shot: Shot, frame: int, *, ended: bool) -> Image.Image:
    panel = Image.new("RGB", (WIDTH, HEIGHT + 2 * LINE), "white")
    image = Image.fromarray(shot.frames[min(frame, len(shot.frames) - 1)]).resize((WIDTH, HEIGHT))
    panel.paste(image, (0, LINE))
    draw, font = ImageDraw.Draw(panel), ImageFont.load_default(13)
    draw.text((6, 1), f"“{shot.command}”", "black", font)
    if shot.found:
        x, y = shot.centre[0] * WIDTH, LINE + shot.centre[1] * HEIGHT
        draw.ellipse((x - 14, y - 14, x + 14, y + 14), outline="magenta", width=2)
        draw.text((x + 16, y - 16), f"{shot.score:.2f}", "magenta", font)
    if ended:
        draw.text((6, LINE + HEIGHT + 1), f"NICO: {shot.says}", "black", font)
    return panel


@command("film")
def main(config: FilmConfig) -> None:
    """Roll out, draw, and say what happened."""
    trained = PreTrainedConfig.from_pretrained(config.checkpoint, cli_overrides=config.policy_options)
    policy = OWLxT5Policy.from_pretrained(config.checkpoint, config=trained)
    processors = make_pre_post_processors(policy.config, str(config.checkpoint))
    shots = [Shot(policy, processors, *shot) for shot in SHOTS]
    for shot in shots:
        print(f"{shot.command}: score {shot.score:.2f}, {shot.outcome}; says: {shot.says}")
    steps = max(len(shot.frames) for shot in shots)
    pages = []
    for number in range(0, steps // EVERY + REST):
        rows = -(-len(shots) // COLUMNS)
        page = Image.new("RGB", (COLUMNS * WIDTH, rows * (HEIGHT + 2 * LINE)), "white")
        for place, shot in enumerate(shots):
            corner = place % COLUMNS * WIDTH, place // COLUMNS * (HEIGHT + 2 * LINE)
            page.paste(_panel(shot, number * EVERY, ended=number * EVERY >= steps - 1), corner)
        pages.append(page)
    animation = {"save_all": True, "append_images": pages[1:], "duration": 100 * EVERY, "loop": 0}
    pages[0].save(config.image, quality=80, **animation)
    print(f"{config.image}: {config.image.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
