# SPDX-License-Identifier: Apache-2.0
"""`owlxt5-talk`: a page in the browser to talk to the simulated robot (docs/talk.md)."""

import logging
import os
import secrets
import threading
from dataclasses import dataclass
from pathlib import Path

import torch
from lerobot.configs import parser
from lerobot.robots import Robot
from transformers.utils.logging import disable_progress_bar

from lerobot_owlxt5.command_line import check_given, run_with_policy
from lerobot_owlxt5.conversation import Conversation
from lerobot_owlxt5.conversation.chat_planner import ChatPlanner, planner_of
from lerobot_owlxt5.conversation.rules import plan_by_rules
from nico_tabletop.drawing import DrawingError

from .page import build_page, open_page
from .policies import policy_maker
from .visitor import Visitor
from .visitors import Visitors
from .world import Table, TalkingRobot, World


@dataclass
class TalkConfig:
    """Talk to the simulated robot NICO in the browser; --policy.path names another policy."""

    # Where the page is: 127.0.0.1 is this computer alone, 0.0.0.0 whoever reaches it.
    host: str = "127.0.0.1"
    port: int = 7860
    # So many people have a robot at once.
    visitors: int = 2
    # What stands on the table at first: clant, claeo or household.
    objects: str = "claeo"
    # How it stands there at first: slots or free.
    placement: str = "slots"
    # File that keeps what things look like that people teach the robot; without one it forgets them.
    taught: Path | None = None

    def check(self) -> None:
        """Check the options.

        Raises:
            ValueError: If one cannot be used.
        """
        check_given(self)
        if not 1 <= self.port <= 65535:
            raise ValueError(f"--port must lie between 1 and 65535; got {self.port}")
        if self.visitors < 1:
            raise ValueError(f"--visitors must be above 0; got {self.visitors}")

    @classmethod
    def __get_path_fields__(cls) -> list[str]:
        """LeRobot's parser leaves `--policy.path`, and the other `--policy` options with it, to us."""
        return ["policy"]


def make_visitors(
    most: int, table: Table, planner: ChatPlanner | None = None, taught: Path | None = None
) -> Visitors:
    """All who will come: each gets a world with a robot, a policy and a conversation of their own.

    Args:
        most: So many at once.
        table: What they find.
        planner: Decides what the robots do; rules if None.
        taught: File that keeps what people teach them.

    Raises:
        ValueError, OSError: If the policy cannot be had.
    """
    # Each visitor's robot computes in its own thread; more threads of each would wait for a core.
    torch.set_num_threads(max(1, torch.get_num_threads() // most))
    make_policy = policy_maker(taught)

    def make_world(chosen: Table) -> World:
        policy, processors = make_policy()

        def converse(robot: Robot) -> TalkingRobot:
            conversation = Conversation(robot, policy, processors, planner or plan_by_rules)
            conversation.look()  # then things are there to be named
            return conversation

        return World(converse, chosen, secrets.randbelow(2**31))

    return Visitors(lambda: Visitor(make_world, table), most)


@parser.wrap()
def _talk(config: TalkConfig) -> None:
    config.check()
    table = Table(config.objects, config.placement)
    planner = planner_of(os.environ)
    if planner:
        server = planner.server
        print(f"The model {server.model} at {server.host} plans: what people say goes there too.", flush=True)
    visitors = make_visitors(config.visitors, table, planner, config.taught)
    page = build_page(visitors, table, sends_words=planner is not None)
    try:
        address = open_page(page, config.host, config.port)
    except OSError:
        raise ValueError(
            f"the page cannot be at --host={config.host} --port={config.port}: something else is there, or "
            "the host is not this computer; choose another port"
        ) from None
    print(f"Open {address} in a browser to talk to NICO; Ctrl-C ends it.", flush=True)
    threading.Event().wait()


def main() -> None:
    """Entry point; an error that the user can mend ends in one message and exit status 1."""
    disable_progress_bar()
    logging.getLogger("httpx").setLevel(logging.WARNING)
    try:
        run_with_policy("owlxt5-talk", TalkConfig, _talk, DrawingError)
    except KeyboardInterrupt:
        print()


if __name__ == "__main__":
    main()
