# SPDX-License-Identifier: Apache-2.0
"""What the policies OWLxT5 and CrossT5 have in common: all but their eyes."""

from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np
import torch
from lerobot.configs import PreTrainedConfig
from lerobot.policies.pretrained import PreTrainedPolicy
from lerobot.utils.constants import ACTION, OBS_STATE
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

from . import made_up_names, modes
from .action import hold_after_stop
from .annotations import EpisodeTexts, read_texts
from .commands import object_name, parse_command, spoken, with_article
from .configuration_crossmodal import CORE_VERSION, CrossmodalConfig
from .core import CrossmodalCore, Thought
from .episodes import (
    RememberedActions,
    at_step,
    check_episode_lengths,
    positions_before,
    recover_actions,
)
from .language import SplitT5
from .pretrained import EMBEDDED

if TYPE_CHECKING:
    from lerobot.datasets import LeRobotDatasetMetadata

# The stop output is our addition; it shares the action decoder, and must not outshout the joints there.
STOP_LOSS_WEIGHT = 0.1
# In execute and translate the action encoder reads the first pose, repeated (paper, section 3): for a second.
# More steps of the same say nothing new and cost as much as a movement (our decision).
STILL_STEPS = 10
NOTHING_MOVED = "nothing moved"
"""What `describe` answers when there is nothing to describe."""


class Lessons(NamedTuple):
    """What each sample of a training batch is asked for.

    Attributes:
        mode: (batch,) indices into `modes.MODES`.
        prompts: Text that goes in.
        texts: Text that should come out; not used in translate.
    """

    mode: Tensor
    prompts: list[str]
    texts: list[str]


class View(NamedTuple):
    """What the eyes saw.

    Attributes:
        visual: (batch, steps, dim_visual); one step where it stays the same.
        found: (batch,) bool: was the object that the task names seen?
    """

    visual: Tensor
    found: Tensor


class CrossmodalPolicy(PreTrainedPolicy):
    """Executes, describes and repeats actions, repeats language and translates.

    The eyes, which a subclass adds, look at the scene, T5's encoder reads the prompt, the crossmodal core
    joins both with the joints, and T5's decoder and the action decoder say and do what was asked for. The
    policy plans once, at the beginning of an episode, and then carries the plan out.
    """

    # LeRobot asks both of each class, of this unfinished one too.
    config_class = CrossmodalConfig
    name = "crossmodal"
    dim_visual: ClassVar[int]
    training_seed: Tensor
    rest_pose: Tensor

    def __init__(
        self,
        config: CrossmodalConfig,
        dataset_meta: "LeRobotDatasetMetadata | None" = None,
        **kwargs: Any,
    ) -> None:
        """Make the policy.

        Args:
            config: The configuration; its features are checked here.
            dataset_meta: The training data, if the policy is going to be trained.
            **kwargs: What LeRobot passes to all policies and this one has no use for.
        """
        super().__init__(config)
        config.validate_features()
        self.config: CrossmodalConfig = config
        self._texts: dict[int, EpisodeTexts] = {}
        self._actions: RememberedActions | None = None
        if dataset_meta is not None:
            config.check_dataset(dataset_meta.features)
            check_episode_lengths(dataset_meta, config.max_episode_steps)
            self._actions = RememberedActions(dataset_meta, config.max_episode_steps)
            self._texts = read_texts(dataset_meta)
            config.tasks = list(dict.fromkeys([*(config.tasks or []), *dataset_meta.tasks.index]))

        self.language = SplitT5(
            config.language_model, config.language_model_revision, frozen=not config.train_language_model
        )
        config.language_model_revision = self.language.revision
        if config.train_language_model:
            self.language_model = self.language.model
        config.core_version = CORE_VERSION
        n_joints = config.action_feature.shape[0]
        self.core = CrossmodalCore(
            self.language.dim,
            self.dim_visual,
            n_joints,
            dim_model=config.dim_model,
            n_heads=config.n_heads,
            dim_feedforward=config.dim_feedforward,
            dropout=config.dropout,
            dim_lstm=config.dim_lstm,
            n_lstm_layers=config.n_lstm_layers,
        )
        # LeRobot restores the global generator when a run is resumed, but its data loader then draws from it
        # before the first step. With a seed of its own in the checkpoint, a resumed run equals an unbroken
        # one.
        self.register_buffer("training_seed", torch.randint(2**31, ()))
        # Translation needs no robot, but a pose to begin with: the one that the last training batch had.
        self.register_buffer("rest_pose", torch.zeros(n_joints))
        self.reset()

    @classmethod
    def from_pretrained(
        cls,
        pretrained_name_or_path: str | Path,
        *,
        config: PreTrainedConfig | None = None,
        strict: bool = True,
        **kwargs: Any,
    ) -> Self:
        """Load a checkpoint as LeRobot does, but refuse weights of another model.

        LeRobot only warns by default, and what is missing stays random: the robot would move anyhow.

        Raises:
            RuntimeError: If parameters are missing or unknown; it names them.
            ValueError: If the checkpoint's parameters mean something else in this version.
        """
        if config is None:
            config = PreTrainedConfig.from_pretrained(pretrained_name_or_path, **kwargs)
        assert isinstance(config, CrossmodalConfig)
        config.check_core_version(str(pretrained_name_or_path))
        return super().from_pretrained(pretrained_name_or_path, config=config, strict=strict, **kwargs)

    # Eyes ---------------------------------------------------------------------------------------------------

    @abstractmethod
    def _watch(self, batch: dict[str, Any]) -> View:
        """Look at a batch's frames: one, or as many as there are actions."""

    @abstractmethod
    def _remember(self, batch: dict[str, Any]) -> View:
        """The same for a training batch, whose episodes come by again and again."""

    @abstractmethod
    def _describe_prompt(self, task: str) -> str:
        """Ask what was done in an episode with this task."""

    def get_optim_params(self) -> list[nn.Parameter]:
        """All parameters that learn: the core, and T5 if it is trained along."""
        return [parameter for parameter in self.parameters() if parameter.requires_grad]

    def _get_default_peft_targets(self) -> dict[str, Any]:
        """Adapt all linear layers, and T5's queries and values if it is trained along; LoRA knows no LSTM."""
        core = r"core\.(crossmodal\.(queries|keys|feedforward\.[03])|fc|decoder\.(initial|joints|stop))"
        return {"target_modules": rf"{core}|language_model\..*\.[qv]", "modules_to_save": []}

    def reset(self) -> None:
        """Forget the plan: a new episode begins."""
        self._plan: Tensor | None = None
        self._next_step = 0
        self._sayings: list[str] = []

    # Training -----------------------------------------------------------------------------------------------

    def forward(self, batch: dict[str, Any]) -> tuple[Tensor, dict[str, float]]:
        """Compute the mixed loss (paper, section 3) of a batch, each sample in a mode of its own.

        In training the modes are drawn; in evaluation they follow from the frame's index.

        Args:
            batch: `observation.state` and the camera at the episode's first frame, `action` at any frame, and
                `task`, `episode_index` and `index`.

        Returns:
            The loss and its terms: `joint_loss` (mean squared error of the scaled joints over true steps),
            `language_loss` (cross entropy of the text, or in translate mean squared error of the encoding),
            `stop_loss` (binary cross entropy), and `found`, the share of samples whose object was detected.
        """
        device = batch[ACTION].device
        with torch.random.fork_rng([device] if device.type == "cuda" else [], enabled=self.training):
            if self.training:
                self.training_seed += 1
                # For dropout; by the first sample, as the parts of a batch on several GPUs are to differ.
                [dice] = self._dice(batch["index"].flatten()[:1])
                torch.manual_seed(int(dice.integers(2**63)))
            return self._mixed_loss(batch)

    def _mixed_loss(self, batch: dict[str, Any]) -> tuple[Tensor, dict[str, float]]:
        if self._actions is None:
            raise ValueError(
                "Training needs the data set: make the policy with `dataset_meta`, as LeRobot does."
            )
        actions, length = self._actions(batch)
        pose = self._first_pose(batch)
        if self.training:
            self.rest_pose = pose.mean(dim=0)
        lessons = self._make_lessons(batch)
        mode = lessons.mode.to(pose.device)
        view = self._remember(batch)

        moves = (mode == modes.EXECUTE) | (mode == modes.REPEAT_ACTION)
        visual = _choose(mode != modes.TRANSLATE, view.visual, torch.zeros_like(view.visual))
        summary, language_loss = self._think_in_modes(lessons, visual, pose, actions)
        # Where nothing moves, the decoder begins with the pose that it is to hold, in describe the last one.
        describes = mode == modes.DESCRIBE
        start = torch.where(describes[:, None], actions[:, -1], pose)
        target = _choose(moves, actions, _held(start, actions))
        # It sees the frames of a movement that it repeats, else one: nobody has seen a movement to come.
        shown = _choose(describes, visual[:, -1:], visual[:, :1])
        shown = _choose(mode == modes.REPEAT_ACTION, visual, shown.expand_as(visual))
        # What a sample's loss is must not depend on the rest of its batch, nor then on how a batch is split
        # among GPUs: so always all steps, and below a mean over the data set.
        step = torch.arange(actions.shape[1], device=pose.device)
        moved, stop_logits = self.core.decoder(summary, shown, start, len(step))

        # LeRobot draws frames, so a long episode comes more often; every episode is to count the same, as in
        # the paper's epochs.
        share = self._actions.mean_length / length
        true_step = step < length[:, None]
        error = (moved - target).square().mean(dim=-1)
        joint_loss = share * (error * true_step).sum(dim=1) / length
        # Where a pose is held, there is nothing to wait for: stop from the first step on.
        stopped = (step >= length[:, None] - 1) | ~moves[:, None]
        stop_loss = share * binary_cross_entropy_with_logits(
            stop_logits, stopped.to(stop_logits), reduction="none"
        ).mean(dim=1)
        language_loss = share * language_loss
        loss = language_loss + self.config.joint_loss_weight * (joint_loss + STOP_LOSS_WEIGHT * stop_loss)
        _check_finite(loss, batch)
        return loss.mean(), {
            "joint_loss": joint_loss.mean().item(),
            "language_loss": language_loss.mean().item(),
            "stop_loss": stop_loss.mean().item(),
            "found": view.found.float().mean().item(),
        }

    def _make_lessons(self, batch: dict[str, Any]) -> Lessons:
        tasks: list[str] = batch["task"]
        episodes = [
            self._texts.get(episode, EpisodeTexts()) for episode in batch["episode_index"].flatten().tolist()
        ]
        probabilities = torch.tensor(
            [
                [
                    self.config.mode_probabilities.get(mode, 0.0)
                    * (mode != "translate" or texts.sentence is not None)
                    for mode in modes.MODES
                ]
                for texts in episodes
            ]
        )
        dice = self._dice(batch["index"])
        chance = (
            torch.tensor([each.random() for each in dice], dtype=torch.float64)
            if self.training
            else modes.spread(batch["index"].flatten().cpu())
        )
        mode = modes.draw_modes(probabilities, chance)
        prompts, answers = [], []
        for drawn, task, texts, each in zip(mode.tolist(), tasks, episodes, dice, strict=True):
            task, wording = self._choose_words(task, texts, each) if self.training else (task, task)
            prompts.append(
                (
                    modes.execute_prompt(wording),
                    self._describe_prompt(task),
                    modes.repeat_action_prompt(),
                    modes.translate_prompt(texts.sentence or ""),
                    modes.repeat_language_prompt(wording),
                )[drawn]
            )
            spoken_back = {modes.DESCRIBE: task, modes.REPEAT_LANGUAGE: wording}
            answers.append(spoken(spoken_back.get(drawn, "")))
        return Lessons(mode, prompts, answers)

    def _dice(self, index: Tensor) -> list[np.random.Generator]:
        """Each frame's own random numbers for this step, whatever its place in the batch and its GPU."""
        seed = int(self.training_seed)
        return [np.random.default_rng([seed, frame]) for frame in index.flatten().tolist()]

    @property
    def _meets_made_up_names(self) -> bool:
        return self.config.train_language_model or self.config.language_model == EMBEDDED

    def _choose_words(self, task: str, texts: EpisodeTexts, dice: np.random.Generator) -> tuple[str, str]:
        """Task and wording of it to train with; now and then, for a small T5, both with a made-up name."""
        wordings = texts.wordings or (task,)
        wording = wordings[dice.integers(len(wordings))]
        if self._meets_made_up_names and dice.random() < made_up_names.SHARE:
            name = made_up_names.draw_name(dice)
            return made_up_names.rename_object(task, name), made_up_names.rename_object(wording, name)
        return task, wording

    def _think_in_modes(
        self, lessons: Lessons, visual: Tensor, pose: Tensor, actions: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Summary (batch, dim_model) and language loss (batch,) of all samples.

        The samples of a mode are of one kind, long prompts or short ones, movements or none: mode by mode,
        little work goes into padding.
        """
        chosen = [(lessons.mode == mode).nonzero().flatten() for mode in range(len(modes.MODES))]
        summaries, losses = [], []
        for mode, samples in enumerate(chosen):
            if not len(samples):
                continue
            prompts, texts = ([of[i] for i in samples.tolist()] for of in (lessons.prompts, lessons.texts))
            encoding, mask = self.language.encode(prompts, pose.device)
            seen, first_pose = visual[samples], pose[samples]
            if mode in (modes.DESCRIBE, modes.REPEAT_ACTION):
                joints = positions_before(first_pose, actions[samples])
            else:
                seen, joints = seen[:, :1], _still(first_pose)
            thought = self.core.think(encoding, mask, seen, joints)
            summaries.append(thought.summary)
            losses.append(
                _change_loss(thought.change, mask)
                if mode == modes.TRANSLATE
                else self.language.text_loss(encoding + thought.change, mask, texts)
            )
        in_order = torch.cat(chosen).argsort().to(pose.device)
        return torch.cat(summaries)[in_order], torch.cat(losses)[in_order]

    # Execute ------------------------------------------------------------------------------------------------

    @torch.no_grad()
    def select_action(self, batch: dict[str, Any], **kwargs: Any) -> Tensor:
        """Return the next action of the plan; make the plan if there is none.

        Args:
            batch: Observation of a batch of environments, with their tasks in `task`.
            **kwargs: Not used.

        Returns:
            (batch, joints), scaled to [-1, 1]. After the plan's end the last action is held.
        """
        if self._plan is None:
            self._plan = self.predict_action_chunk(batch)
        action = self._plan[:, min(self._next_step, self._plan.shape[1] - 1)]
        self._next_step += 1
        return action

    @torch.no_grad()
    def predict_action_chunk(self, batch: dict[str, Any], **kwargs: Any) -> Tensor:
        """Plan a whole episode for each environment, and note what to say about it.

        An object that is not seen and a command that is not known make the robot hold still.

        Args:
            batch: Observation at the beginning of the episode, with the tasks in `task`.
            **kwargs: Not used.

        Returns:
            (batch, L, joints), scaled to [-1, 1].

        Raises:
            ValueError: If there are other joints than in training, or a joint's position is not finite: then
                there is not even a pose to hold.
            FloatingPointError: If the plan is not finite.
        """
        self.eval()
        _check_state(batch[OBS_STATE], self.config.action_feature.shape[0])
        tasks: list[str] = batch["task"]
        commands = [parse_command(task) for task in tasks]
        view = self._watch(batch)
        trained = self.config.tasks or []
        understood = [
            command.verb is not None or task in trained for command, task in zip(commands, tasks, strict=True)
        ]
        # A task of other training data, without a verb of ours, names no object that could be missed.
        able = [
            knows and (sees or command.verb is None)
            for command, knows, sees in zip(commands, understood, view.found.tolist(), strict=True)
        ]
        self._sayings = [
            command.refusal
            if not knows
            else command.done
            if can
            else f"I cannot see {with_article(object_name(command.object))}."
            for command, knows, can in zip(commands, understood, able, strict=True)
        ]
        pose = self._first_pose(batch)
        # The language model was not trained on free wording: it is told the same in CLANT's words.
        prompts = [
            modes.execute_prompt(task if task in trained or command.verb is None else command.canonical)
            for command, task in zip(commands, tasks, strict=True)
        ]
        actions = self._move(prompts, view.visual[:, :1], _still(pose))
        return _choose(torch.tensor(able, device=pose.device), actions, _held(pose, actions))

    def say(self) -> list[str]:
        """One sentence for each environment on the plan that was made last; empty before the first plan."""
        return self._sayings

    # The other modes ----------------------------------------------------------------------------------------

    @abstractmethod
    def describe(self, batch: dict[str, Any], labels: Sequence[str] | None = None) -> list[str]:
        """Say what was done to which object.

        Args:
            batch: `action` (batch, 2L - 1, joints) with `action_is_pad`, as `episode_delta_indices` of the
                configuration requests them, and the observations, as `describe_delta_indices` does.
            labels: Names of the objects that may have been moved; by default those of the training tasks.

        Returns:
            One description per sample, or `NOTHING_MOVED`.
        """

    @torch.no_grad()
    def repeat_action(self, batch: dict[str, Any]) -> Tensor:
        """Reproduce an action.

        Args:
            batch: As for `describe`, and `task`, which names the object.

        Returns:
            (batch, L, joints), scaled to [-1, 1] and held after the stop output.
        """
        self.eval()
        joints = self._recorded_joints(batch)
        prompts = [modes.repeat_action_prompt()] * len(joints)
        return self._move(prompts, self._watch(batch).visual, joints)

    @torch.no_grad()
    def translate(self, sentences: Sequence[str], batch: dict[str, Any] | None = None) -> list[str]:
        """Translate English sentences into German.

        Args:
            sentences: One per sample.
            batch: May hold the robot's pose in `observation.state`, (batch, joints), scaled.
        """
        return self._answer([modes.translate_prompt(sentence) for sentence in sentences], None, batch)

    def _answer(
        self, prompts: Sequence[str], visual: Tensor | None, batch: dict[str, Any] | None
    ) -> list[str]:
        """What the robot says to prompts when it does not move."""
        self.eval()
        pose = self.rest_pose.expand(len(prompts), -1) if batch is None else self._first_pose(batch)
        if visual is None:
            visual = pose.new_zeros(len(pose), 1, self.dim_visual)
        return self._speak(prompts, visual, _still(pose))

    # Common -------------------------------------------------------------------------------------------------

    def _think(
        self, prompts: Sequence[str], visual: Tensor, joints: Tensor
    ) -> tuple[Thought, Tensor, Tensor]:
        encoding, mask = self.language.encode(prompts, joints.device)
        return self.core.think(encoding, mask, visual, joints), encoding, mask

    def _move(self, prompts: Sequence[str], visual: Tensor, joints: Tensor) -> Tensor:
        """A movement for each prompt, (batch, L, joints); after its stop output the pose is held."""
        thought, _, _ = self._think(prompts, visual, joints)
        actions, stop_logits = self.core.decoder(
            thought.summary, visual, joints[:, 0], self.config.max_episode_steps
        )
        if not actions.isfinite().all():
            raise FloatingPointError(
                "The planned movement is not finite, so nothing moves. Either the observation is not finite, "
                "or the checkpoint's weights are not, because its training diverged: load an earlier one."
            )
        return hold_after_stop(actions, stop_logits)

    def _speak(self, prompts: Sequence[str], visual: Tensor, joints: Tensor) -> list[str]:
        """A text for each prompt."""
        thought, encoding, mask = self._think(prompts, visual, joints)
        return self.language.generate(encoding + thought.change, mask, self.config.max_text_tokens)

    def _recorded_joints(self, batch: dict[str, Any]) -> Tensor:
        """Joints at each step of finished episodes, (batch, L, joints)."""
        actions, _ = recover_actions(batch[ACTION], batch["action_is_pad"])
        return positions_before(self._first_pose(batch), actions)

    def _first_pose(self, batch: dict[str, Any]) -> Tensor:
        """Scaled joints at the first step, (batch, joints); they may lie just outside the trained range."""
        return at_step(batch[OBS_STATE], 0, ndim=2).clamp(-1.0, 1.0)


def _choose(condition: Tensor, chosen: Tensor, other: Tensor) -> Tensor:
    """Choose between whole sequences (batch, steps, joints) by a condition (batch,)."""
    return torch.where(condition[:, None, None], chosen, other)


def _held(pose: Tensor, actions: Tensor) -> Tensor:
    """The pose (batch, joints) at each of the steps that the actions have."""
    return pose[:, None].expand_as(actions)


def _still(pose: Tensor) -> Tensor:
    """What the action encoder reads when nothing has moved yet, (batch, STILL_STEPS, joints)."""
    return pose[:, None].expand(-1, STILL_STEPS, -1)


def _change_loss(change: Tensor, mask: Tensor) -> Tensor:
    """Translate: mean((l_enc + FC(h) - l_enc)^2) over true tokens, (batch,): T5's own encoding is to stay."""
    weight = mask.unsqueeze(-1)
    return (change.square() * weight).sum(dim=(1, 2)) / (weight.sum(dim=(1, 2)) * change.shape[-1])


def _check_state(state: Tensor, joints: int) -> None:
    """Stop a robot that has other joints, or does not know where they are; state is (batch, ..., joints)."""
    if state.shape[-1] != joints:
        raise ValueError(
            f"'{OBS_STATE}' has {state.shape[-1]} numbers, and the policy was trained on {joints} joints: "
            "this environment or robot is another one than that of the training data."
        )
    bad = (~state.isfinite()).nonzero()
    if len(bad):
        raise ValueError(
            f"'{OBS_STATE}' of environment {int(bad[0, 0])} is not finite at joint {int(bad[0, -1])} (both "
            "counted from 0), so there is no safe action. Check the robot's sensors."
        )


def _check_finite(loss: Tensor, batch: dict[str, Any]) -> None:
    """Stop before a loss (batch,) that is no number ruins the weights, and say where it comes from."""
    bad = ~loss.isfinite()
    if bad.any():
        episodes = sorted(set(batch["episode_index"].flatten().cpu()[bad.cpu()].tolist()))
        raise FloatingPointError(
            f"The loss of episodes {episodes} is not finite. If they hold no value that is not finite, the "
            "training diverged: resume from the last checkpoint with a smaller --policy.optimizer_lr."
        )
