# SPDX-License-Identifier: Apache-2.0
"""What the robots of a batch of environments are carrying out."""

from collections.abc import Sequence

import torch
from torch import Tensor


class Plans:
    """One plan for each environment: for which task it was made, and how far it has been carried out."""

    def __init__(self) -> None:
        self._actions: Tensor | None = None
        self._tasks: list[str] = []
        self._steps: list[int] = []
        self._responses: list[str] = []

    def fit(self, tasks: Sequence[str]) -> bool:
        """Whether each environment has a plan, and for this task."""
        return self._tasks == [*tasks]

    def renew(self, tasks: Sequence[str], actions: Tensor, responses: Sequence[str]) -> list[str]:
        """Take the new plans of the environments whose task is another one; the others go on.

        Args:
            tasks: One for each environment.
            actions: New plans for all of them, (environments, L, joints).
            responses: What is said on these plans.

        Returns:
            What was said on the plans that are carried out now.
        """
        if self._actions is None or len(tasks) != len(self._tasks):
            self._actions, self._steps, self._responses = actions, [0] * len(tasks), [*responses]
        else:
            new = [task != planned for task, planned in zip(tasks, self._tasks, strict=True)]
            chosen = torch.tensor(new, device=actions.device)[:, None, None]
            self._actions = torch.where(chosen, actions, self._actions)
            self._steps = [0 if is_new else step for is_new, step in zip(new, self._steps, strict=True)]
            self._responses = [
                now if is_new else before
                for is_new, now, before in zip(new, responses, self._responses, strict=True)
            ]
        self._tasks = [*tasks]
        return [*self._responses]

    def next_action(self) -> Tensor:
        """The next action of each plan, (environments, joints); after a plan's end the last one is held."""
        assert self._actions is not None
        last = self._actions.shape[1] - 1
        action = self._actions[range(len(self._steps)), [min(step, last) for step in self._steps]]
        self._steps = [step + 1 for step in self._steps]
        return action
