# SPDX-License-Identifier: Apache-2.0
"""The policy OWLxT5: "Open-Vocabulary Robotic Object Manipulation using Foundation Models"."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import torch
from lerobot.policies.pretrained import PreTrainedPolicy
from lerobot.utils.constants import ACTION, OBS_STATE
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

from . import made_up_names, modes
from .action import hold_after_stop
from .annotations import EpisodeTexts, read_texts
from .commands import object_name, parse_command, spoken, with_article
from .configuration_owlxt5 import OWLxT5Config
from .core import CoreOutput, CrossmodalCore
from .detection import RememberedDetections, make_detector
from .episodes import at_step, check_episode_lengths, positions_before, recover_actions
from .language import SplitT5

if TYPE_CHECKING:
    from lerobot.datasets import LeRobotDatasetMetadata

DIM_VISUAL = 2
# The stop output is our addition; it shares the action decoder, and must not outshout the joints there.
STOP_LOSS_WEIGHT = 0.1
# An object whose centre moved less than this share of the image has not moved: the detector's noise.
DETECTION_NOISE = 0.02


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


class OWLxT5Policy(PreTrainedPolicy):
    """Executes, describes and repeats actions, and translates.

    A detector names the position of an object, T5's encoder reads the prompt, the crossmodal core joins both
    with the joints, and T5's decoder and the action decoder say and do what was asked for. The policy plans
    once, at the beginning of an episode, and then carries the plan out.
    """

    config_class = OWLxT5Config
    name = "owlxt5"
    training_seed: Tensor

    def __init__(
        self,
        config: OWLxT5Config,
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
        self.config: OWLxT5Config = config
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
        self.detector = make_detector(config)
        self._remembered_detections = RememberedDetections(self.detector)
        self.core = CrossmodalCore(
            self.language.dim,
            DIM_VISUAL,
            config.action_feature.shape[0],
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
        self.reset()

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
        lessons = self._make_lessons(batch)
        mode = lessons.mode.to(pose.device)
        centre, score = self._remembered_detections(
            batch, [parse_command(task).object for task in batch["task"]]
        )
        found = score > 0
        visual = _scale_centre(centre[:, 0], found & (mode != modes.TRANSLATE)[:, None])

        still = pose[:, None].expand_as(actions)
        sees_movement = (mode == modes.DESCRIBE) | (mode == modes.REPEAT_ACTION)
        moves = (mode == modes.EXECUTE) | (mode == modes.REPEAT_ACTION)
        joints = _choose(sees_movement, positions_before(pose, actions), still)
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
        joint_loss = (error * true_step).sum(dim=1) / length
        # Where a pose is held, there is nothing to wait for: stop from the first step on.
        stopped = (step >= length[:, None] - 1) | ~moves[:, None]
        stop_loss = binary_cross_entropy_with_logits(
            output.stop_logits, stopped.to(output.stop_logits), reduction="none"
        ).mean(dim=1)
        language_loss = self._language_loss(encoding, mask, output.change, lessons)
        joint_loss, language_loss, stop_loss = (
            (share * term).mean() for term in (joint_loss, language_loss, stop_loss)
        )

        loss = language_loss + self.config.joint_loss_weight * (joint_loss + STOP_LOSS_WEIGHT * stop_loss)
        return loss, {
            "joint_loss": joint_loss.item(),
            "language_loss": language_loss.item(),
            "stop_loss": stop_loss.item(),
            "found": found.float().mean().item(),
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
                    modes.describe_prompt(parse_command(task).object),
                    modes.repeat_action_prompt(),
                    modes.translate_prompt(texts.sentence or ""),
                )[drawn]
            )
            answers.append(spoken(task) if drawn == modes.DESCRIBE else "")
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
        centre, score = self.detector(batch, [[command.object] for command in commands])
        found = score > 0
        understood = [
            command.verb is not None or task in (self.config.tasks or [])
            for command, task in zip(commands, tasks, strict=True)
        ]
        # A task of other training data, without a verb of ours, names no object that could be missed.
        able = [
            knows and (sees or command.verb is None)
            for command, knows, sees in zip(commands, understood, found[:, 0].tolist(), strict=True)
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
        output, _, _ = self._run(prompts, _scale_centre(centre[:, 0], found), still)
        actions = hold_after_stop(output.actions, output.stop_logits)
        return _choose(torch.tensor(able, device=pose.device), actions, still)

    def say(self) -> list[str]:
        """One sentence for each environment on the plan that was made last; empty before the first plan."""
        return self._sayings

    # The other modes ----------------------------------------------------------------------------------------

    @torch.no_grad()
    def describe(self, batch: dict[str, Any], labels: Sequence[str] | None = None) -> list[str]:
        """Say what was done to which object.

        The detector looks for all labels in the first and in the last frame; the one that moved most goes
        into the prompt. That is our reading of the paper, whose prompt names no object.

        Args:
            batch: `action` and `action_is_pad` as in training, the camera (or `observation.objects`) with a
                time axis from the episode's first to its last frame, and `observation.state` at the first.
            labels: Names to look for; by default the objects of the training tasks.

        Returns:
            One description per sample, or "nothing moved".
        """
        self.eval()
        names = list(labels) if labels is not None else self._trained_objects()
        actions, _ = recover_actions(batch[ACTION], batch["action_is_pad"])
        pose = self._first_pose(batch)
        asked = [names] * len(pose)
        before, after = self.detector(batch, asked, step=0), self.detector(batch, asked, step=-1)
        seen = (before.score > 0) & (after.score > 0)
        distance, moved = torch.where(seen, (after.centre - before.centre).norm(dim=-1), 0.0).max(dim=1)
        has_moved = distance > DETECTION_NOISE
        centre = before.centre.gather(1, moved[:, None, None].expand(-1, -1, 2))[:, 0]
        prompts = [modes.describe_prompt(names[index]) for index in moved.tolist()]
        output, encoding, mask = self._run(
            prompts, _scale_centre(centre, has_moved[:, None]), positions_before(pose, actions), steps=1
        )
        texts = self.language.generate(encoding + output.change, mask, self.config.max_text_tokens)
        return [
            text if any_moved else "nothing moved"
            for text, any_moved in zip(texts, has_moved.tolist(), strict=True)
        ]

    @torch.no_grad()
    def repeat_action(self, batch: dict[str, Any]) -> Tensor:
        """Reproduce an action.

        Args:
            batch: As in training: the camera and `observation.state` at the first frame, `action` with
                `action_is_pad`, and `task`, which names the object.

        Returns:
            (batch, L, joints), scaled to [-1, 1] and held after the stop output.
        """
        self.eval()
        actions, _ = recover_actions(batch[ACTION], batch["action_is_pad"])
        centre, score = self.detector(batch, [[parse_command(task).object] for task in batch["task"]])
        pose = self._first_pose(batch)
        prompts = [modes.repeat_action_prompt()] * len(pose)
        output, _, _ = self._run(
            prompts, _scale_centre(centre[:, 0], score > 0), positions_before(pose, actions)
        )
        return hold_after_stop(output.actions, output.stop_logits)

    @torch.no_grad()
    def translate(self, sentences: Sequence[str], batch: dict[str, Any]) -> list[str]:
        """Translate English sentences into German.

        Args:
            sentences: One per sample.
            batch: Holds the robot's pose in `observation.state`, (batch, joints).
        """
        self.eval()
        pose = self._first_pose(batch)
        still = pose[:, None].expand(-1, self.config.max_episode_steps, -1)
        prompts = [modes.translate_prompt(sentence) for sentence in sentences]
        output, encoding, mask = self._run(prompts, pose.new_zeros(len(pose), DIM_VISUAL), still, steps=1)
        return self.language.generate(encoding + output.change, mask, self.config.max_text_tokens)

    # Common -------------------------------------------------------------------------------------------------

    def _run(
        self, prompts: Sequence[str], visual: Tensor, joints: Tensor, steps: int | None = None
    ) -> tuple[CoreOutput, Tensor, Tensor]:
        encoding, mask = self.language.encode(prompts, joints.device)
        return self.core(encoding, mask, visual, joints, steps or joints.shape[1]), encoding, mask

    def _first_pose(self, batch: dict[str, Any]) -> Tensor:
        """Scaled joints at the first step, (batch, joints); they may lie just outside the trained range."""
        return at_step(batch[OBS_STATE], 0, ndim=2).clamp(-1.0, 1.0)

    def _trained_objects(self) -> list[str]:
        names = list(dict.fromkeys(parse_command(task).object for task in self.config.tasks or []))
        if not names:
            raise ValueError("The policy was not trained, so it knows no objects to look for: pass `labels`.")
        return names


def _choose(condition: Tensor, chosen: Tensor, other: Tensor) -> Tensor:
    """Choose between whole sequences (batch, steps, joints) by a condition (batch,)."""
    return torch.where(condition[:, None, None], chosen, other)


def _scale_centre(centre: Tensor, found: Tensor) -> Tensor:
    """Scale a box's centre (batch, 2) from [0, 1] to [-1, 1], like the joints; 0 where nothing was found."""
    return torch.where(found, 2 * centre - 1, 0.0)
