# SPDX-License-Identifier: Apache-2.0
"""What the policies OWLxT5 and CrossT5 have in common: all but their eyes."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import torch
from lerobot.policies.pretrained import PreTrainedPolicy
from lerobot.utils.constants import ACTION, OBS_STATE
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

from . import made_up_names, modes
from .action import hold_after_stop
from .annotations import EpisodeTexts, read_texts
from .commands import object_name, parse_command, spoken, with_article
from .configuration_crossmodal import CrossmodalConfig
from .core import CoreOutput, CrossmodalCore
from .episodes import at_step, check_episode_lengths, positions_before, recover_actions
from .language import SplitT5

if TYPE_CHECKING:
    from lerobot.datasets import LeRobotDatasetMetadata

# The stop output is our addition; it shares the action decoder, and must not outshout the joints there.
STOP_LOSS_WEIGHT = 0.1


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
        if dataset_meta is not None:
            check_episode_lengths(dataset_meta, config.max_episode_steps)
            self._texts = read_texts(dataset_meta)
            config.tasks = list(dict.fromkeys([*(config.tasks or []), *dataset_meta.tasks.index]))

        self.language = SplitT5(
            config.language_model, config.language_model_revision, frozen=not config.train_language_model
        )
        if config.train_language_model:
            self.language_model = self.language.model
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
            batch: `observation.state` and the camera at the episode's first frame, `action` (batch, 2L - 1,
                joints) with `action_is_pad`, and `task`, `episode_index` and `index`.

        Returns:
            The loss and its terms: `joint_loss` (mean squared error of the scaled joints over true steps),
            `language_loss` (cross entropy of the text, or in translate mean squared error of the encoding),
            `stop_loss` (binary cross entropy), and `found`, the share of samples whose object was detected.
        """
        device = batch[ACTION].device
        with torch.random.fork_rng([device] if device.type == "cuda" else [], enabled=self.training):
            if self.training:
                torch.manual_seed(int(self.training_seed))
                self.training_seed += 1
            return self._mixed_loss(batch)

    def _mixed_loss(self, batch: dict[str, Any]) -> tuple[Tensor, dict[str, float]]:
        actions, length = recover_actions(batch[ACTION], batch["action_is_pad"])
        pose = self._first_pose(batch)
        if self.training:
            self.rest_pose = pose.mean(dim=0)
        lessons = self._make_lessons(batch)
        mode = lessons.mode.to(pose.device)
        view = self._remember(batch)

        sees_movement = (mode == modes.DESCRIBE) | (mode == modes.REPEAT_ACTION)
        moves = (mode == modes.EXECUTE) | (mode == modes.REPEAT_ACTION)
        still = pose[:, None].expand_as(actions)
        joints = _choose(sees_movement, positions_before(pose, actions), still)
        visual = _choose(sees_movement, view.visual, view.visual[:, :1])
        visual = _choose(mode != modes.TRANSLATE, visual, torch.zeros_like(visual))
        target = _choose(
            moves, actions, _choose(mode == modes.DESCRIBE, actions[:, -1:].expand_as(actions), still)
        )

        steps = int(length.max())
        step = torch.arange(steps, device=pose.device)
        encoding, mask = self.language.encode(lessons.prompts, pose.device)
        output = self.core(encoding, mask, visual, joints, steps)

        # LeRobot draws frames, so a long episode comes more often; every episode is to count the same, as in
        # the paper's epochs.
        share = length.reciprocal() / length.reciprocal().mean()
        true_step = step < length[:, None]
        error = (output.actions - target[:, :steps]).square().mean(dim=-1)
        joint_loss = share * (error * true_step).sum(dim=1) / length
        # Where a pose is held, there is nothing to wait for: stop from the first step on.
        stopped = (step >= length[:, None] - 1) | ~moves[:, None]
        stop_loss = share * binary_cross_entropy_with_logits(
            output.stop_logits, stopped.to(output.stop_logits), reduction="none"
        ).mean(dim=1)
        language_loss = share * self._language_loss(encoding, mask, output.change, lessons)
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
        chance = torch.rand(len(tasks)) if self.training else modes.spread(batch["index"].flatten().cpu())
        mode = modes.draw_modes(probabilities, chance)
        prompts, answers = [], []
        for drawn, task, texts in zip(mode.tolist(), tasks, episodes, strict=True):
            task, wording = self._choose_words(task, texts) if self.training else (task, task)
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

    def _choose_words(self, task: str, texts: EpisodeTexts) -> tuple[str, str]:
        """Task and wording of it to train with; both with a made-up name, if T5 has names to learn."""
        wordings = texts.wordings or (task,)
        wording = wordings[int(torch.randint(len(wordings), ()))]
        if self.config.train_language_model and torch.rand(()) < made_up_names.SHARE:
            name = made_up_names.draw_name()
            return made_up_names.rename_object(task, name), made_up_names.rename_object(wording, name)
        return task, wording

    def _language_loss(self, encoding: Tensor, mask: Tensor, change: Tensor, lessons: Lessons) -> Tensor:
        """Cross entropy of T5's tokens, or in translate mean((l_enc + FC(h) - l_enc)^2): (batch,)."""
        weight = mask.unsqueeze(-1)
        losses = (change.square() * weight).sum(dim=(1, 2)) / (weight.sum(dim=(1, 2)) * change.shape[-1])
        speaks = (lessons.mode != modes.TRANSLATE).nonzero().flatten().tolist()
        if speaks:
            texts = [lessons.texts[sample] for sample in speaks]
            # The sentences to translate are the long prompts: without them, most of the padding goes.
            tokens = int(mask[speaks].sum(dim=1).max())
            hidden = (encoding[:, :tokens] + change[:, :tokens])[speaks]
            text_losses = self.language.text_loss(hidden, mask[speaks, :tokens], texts)
            losses = losses.index_copy(0, torch.tensor(speaks, device=losses.device), text_losses.to(losses))
        return losses

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
        """
        self.eval()
        tasks: list[str] = batch["task"]
        commands = [parse_command(task) for task in tasks]
        view = self._watch(batch)
        understood = [
            command.verb is not None or task in (self.config.tasks or [])
            for command, task in zip(commands, tasks, strict=True)
        ]
        # A task of other training data, without a verb of ours, names no object that could be missed.
        able = [
            knows and (sees or command.verb is None)
            for command, knows, sees in zip(commands, understood, view.found.tolist(), strict=True)
        ]
        self._sayings = [
            f"I do not know how to {spoken(task)}."
            if not knows
            else command.done
            if can
            else f"I cannot see {with_article(object_name(command.object))}."
            for task, command, knows, can in zip(tasks, commands, understood, able, strict=True)
        ]
        pose = self._first_pose(batch)
        still = pose[:, None].expand(-1, self.config.max_episode_steps, -1)
        prompts = [modes.execute_prompt(task) for task in tasks]
        output, _, _ = self._run(prompts, view.visual[:, :1], still)
        actions = hold_after_stop(output.actions, output.stop_logits)
        return _choose(torch.tensor(able, device=pose.device), actions, still)

    def say(self) -> list[str]:
        """One sentence for each environment on the plan that was made last; empty before the first plan."""
        return self._sayings

    # The other modes ----------------------------------------------------------------------------------------

    @abstractmethod
    def describe(self, batch: dict[str, Any], labels: Sequence[str] | None = None) -> list[str]:
        """Say what was done to which object.

        Args:
            batch: `action` and `action_is_pad` as in training, and the observations with a time axis, as
                `describe_delta_indices` of the configuration requests them.
            labels: Names of the objects that may have been moved; by default those of the training tasks.

        Returns:
            One description per sample, or "nothing moved".
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
        actions, _ = recover_actions(batch[ACTION], batch["action_is_pad"])
        pose = self._first_pose(batch)
        prompts = [modes.repeat_action_prompt()] * len(pose)
        output, _, _ = self._run(prompts, self._watch(batch).visual, positions_before(pose, actions))
        return hold_after_stop(output.actions, output.stop_logits)

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
        still = pose[:, None].expand(-1, self.config.max_episode_steps, -1)
        if visual is None:
            visual = pose.new_zeros(len(pose), 1, self.dim_visual)
        return self._speak(prompts, visual, still)

    # Common -------------------------------------------------------------------------------------------------

    def _run(
        self, prompts: Sequence[str], visual: Tensor, joints: Tensor, steps: int | None = None
    ) -> tuple[CoreOutput, Tensor, Tensor]:
        encoding, mask = self.language.encode(prompts, joints.device)
        return self.core(encoding, mask, visual, joints, steps or joints.shape[1]), encoding, mask

    def _speak(self, prompts: Sequence[str], visual: Tensor, joints: Tensor) -> list[str]:
        output, encoding, mask = self._run(prompts, visual, joints, steps=1)
        return self.language.generate(encoding + output.change, mask, self.config.max_text_tokens)

    def _first_pose(self, batch: dict[str, Any]) -> Tensor:
        """Scaled joints at the first step, (batch, joints); they may lie just outside the trained range."""
        return at_step(batch[OBS_STATE], 0, ndim=2).clamp(-1.0, 1.0)


def _choose(condition: Tensor, chosen: Tensor, other: Tensor) -> Tensor:
    """Choose between whole sequences (batch, steps, joints) by a condition (batch,)."""
    return torch.where(condition[:, None, None], chosen, other)


def _check_finite(loss: Tensor, batch: dict[str, Any]) -> None:
    """Stop before a loss (batch,) that is no number ruins the weights, and say where it comes from."""
    bad = ~loss.isfinite()
    if bad.any():
        episodes = sorted(set(batch["episode_index"].flatten().cpu()[bad.cpu()].tolist()))
        raise FloatingPointError(
            f"The loss of episodes {episodes} is not finite. If they hold no value that is not finite, the "
            "training diverged: resume from the last checkpoint with a smaller --policy.optimizer_lr."
        )
