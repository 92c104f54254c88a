# SPDX-License-Identifier: Apache-2.0
"""What the policies OWLxT5 and CrossT5 have in common: all but what they see."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import torch
from lerobot.configs import PreTrainedConfig
from lerobot.policies.pretrained import PreTrainedPolicy
from lerobot.utils.constants import ACTION, OBS_STATE
from torch import Tensor, nn

from .backbones.pretrained import EMBEDDED
from .commands.instruction import interpret
from .commands.parser import named_objects, parse_command
from .commands.prompts import describe_prompt, repeat_action_prompt, translate_prompt
from .configuration_crossmodal import CORE_VERSION, CrossmodalConfig
from .data.episode_store import EpisodeStore, check_episode_lengths
from .data.windows import first_pose, recorded_joints, still
from .losses import mixed_loss
from .mode_sampling import ModeSampler, sample_rngs
from .model.crossmodal_model import CrossmodalModel
from .validation import check_finite_loss, check_state, read_tasks
from .visual_encoder import VisualEncoder

if TYPE_CHECKING:
    from lerobot.datasets import LeRobotDatasetMetadata


class CrossmodalPolicy(PreTrainedPolicy):
    """Executes, describes and repeats actions, repeats language and translates.

    A visual encoder, which a subclass makes, turns images into numbers. The model joins them with prompt and
    joints, and answers with a text and a movement. The policy plans once, at the beginning of an episode,
    and then carries the plan out.

    Attributes:
        responses: One sentence for each environment on the plan that was made last; empty before the first.
            It says what the robot is going to do, not that it was done: nobody has looked yet.
    """

    # LeRobot asks both of each class, of this unfinished one too.
    config_class = CrossmodalConfig
    name = "crossmodal"
    visual: VisualEncoder
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
        config.core_version = CORE_VERSION
        self.config: CrossmodalConfig = config
        self.episodes: EpisodeStore | None = None
        if dataset_meta is not None:
            config.check_dataset(dataset_meta.features)
            check_episode_lengths(dataset_meta, config.max_episode_steps)
            self.episodes = EpisodeStore(dataset_meta)
            config.tasks = list(dict.fromkeys([*(config.tasks or []), *dataset_meta.tasks.index]))
        n_joints = config.action_feature.shape[0]
        self.model = CrossmodalModel(config, n_joints)
        # LeRobot restores the global generator when a run is resumed, but its data loader then draws from it
        # before the first step. With a seed of its own in the checkpoint, a resumed run equals an unbroken
        # one.
        self.register_buffer("training_seed", torch.randint(2**31, ()))
        # Translation needs no robot, but a pose to begin with: the mean first pose of the training data.
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

    def get_optim_params(self) -> list[nn.Parameter]:
        """All parameters that learn: the core, and T5 if it is trained along."""
        return [parameter for parameter in self.parameters() if parameter.requires_grad]

    def _get_default_peft_targets(self) -> dict[str, Any]:
        """Adapt all linear layers, and T5's queries and values if it is trained along; LoRA knows no LSTM."""
        core = r"core\.(crossmodal\.(queries|keys|feedforward\.[03])|fc|decoder\.(initial|joints|stop))"
        return {"target_modules": rf"model\.({core}|language_model\..*\.[qv])", "modules_to_save": []}

    def reset(self) -> None:
        """Forget the plan: a new episode begins."""
        self._plan: Tensor | None = None
        self._next_step = 0
        self.responses: list[str] = []

    # Training -----------------------------------------------------------------------------------------------

    def forward(self, batch: dict[str, Any]) -> tuple[Tensor, dict[str, float]]:
        """Compute the mixed loss (paper, section 3; `losses`) of a batch, each sample in a mode of its own.

        In training the modes are drawn; in evaluation they follow from the frame's index.

        Args:
            batch: `observation.state` and the camera at the episode's first frame, `action` at any frame, and
                `task`, `episode_index` and `index`.

        Returns:
            The loss and its terms: `joint_loss`, `language_loss`, `stop_loss`, and `found`, the share of
            samples whose object was detected.

        Raises:
            ValueError: If the policy was made without a dataset.
            FloatingPointError: If the loss is not finite.
        """
        if self.episodes is None:
            raise ValueError(
                "Training needs the dataset: make the policy with `dataset_meta`, as LeRobot does."
            )
        sampler = ModeSampler(
            self.config.mode_probabilities,
            self.episodes.texts,
            names_objects=self.visual.names_objects,
            # A T5 that is neither small nor trained along knows names from its own training.
            pseudo_names=self.config.train_language_model or self.config.language_model == EMBEDDED,
        )
        device = batch[ACTION].device
        with torch.random.fork_rng([device] if device.type == "cuda" else [], enabled=self.training):
            rngs = None
            if self.training:
                self.training_seed += 1
                seed = int(self.training_seed)
                # For dropout; by the first sample, as the parts of a batch on several GPUs are to differ.
                [rng] = sample_rngs(seed, batch["index"].flatten()[:1])
                torch.manual_seed(int(rng.integers(2**63)))
                rngs = sample_rngs(seed, batch["index"])
                self.rest_pose = self.episodes.initial_pose.to(self.rest_pose)
            actions, length = self.episodes.actions(batch, self.config.max_episode_steps)
            names = [parse_command(task).object for task in read_tasks(batch)]
            seen = self.visual.encode_cached(batch, names, self.episodes)
            modes = sampler.sample(batch, rngs)
            self.config.note_modes(modes.mode.tolist() if self.training else ())
            terms = mixed_loss(
                self.model,
                modes,
                seen.features,
                first_pose(batch),
                actions,
                length,
                mean_length=self.episodes.mean_length,
                joint_loss_weight=self.config.joint_loss_weight,
            )
        check_finite_loss(terms.loss, batch)
        return terms.loss.mean(), {
            "joint_loss": terms.joint.mean().item(),
            "language_loss": terms.language.mean().item(),
            "stop_loss": terms.stop.mean().item(),
            "found": seen.object_found.float().mean().item(),
        }

    def _begin(self, mode: str) -> None:
        """Without dropout, and for nothing that was never learnt."""
        self.eval()
        self.config.check_mode(mode)

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
        """Plan a whole episode for each environment, and note what to say about it in `responses`.

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
        self._begin("execute")
        check_state(batch[OBS_STATE], self.config.action_feature.shape[0])
        instructions = [interpret(task, self.config.tasks or ()) for task in read_tasks(batch)]
        seen = self.visual.encode(batch, [instruction.command.object for instruction in instructions])
        found: list[bool] = seen.object_found.tolist()
        paired = list(zip(instructions, found, strict=True))
        self.responses = [instruction.response(sees) for instruction, sees in paired]
        pose = first_pose(batch)
        prompts = [instruction.prompt for instruction in instructions]
        actions = self.model.plan(prompts, seen.features[:, :1], still(pose), self.config.max_episode_steps)
        moves = torch.tensor([instruction.may_move(sees) for instruction, sees in paired], device=pose.device)
        return torch.where(moves[:, None, None], actions, pose[:, None])

    # The other modes ----------------------------------------------------------------------------------------

    @torch.no_grad()
    def describe(self, batch: dict[str, Any], labels: Sequence[str] | None = None) -> list[str]:
        """Say what was done to which object.

        Args:
            batch: `action` (batch, 2L - 1, joints) with `action_is_pad`, as `episode_delta_indices` of the
                configuration requests them, and the observations, as `describe_delta_indices` does;
                `data.windows.finished_episode` makes one of a rollout.
            labels: Names of the objects that may have been moved; by default those of the training tasks.

        Returns:
            One description per sample, `NOTHING_MOVED` or `NOTHING_KNOWN` (`commands.instruction`).
        """
        self._begin("describe")
        if labels is None:
            labels = named_objects(self.config.tasks or [])
        if not labels and self.visual.names_objects:
            raise ValueError("The policy was not trained, so it knows no objects to look for: pass `labels`.")
        seen = self.visual.find_moved(batch, labels)
        prompts = [describe_prompt(label) for label in seen.labels]
        return seen.answers(self.model.generate_text(prompts, seen.features, recorded_joints(batch)))

    @torch.no_grad()
    def repeat_action(self, batch: dict[str, Any]) -> Tensor:
        """Reproduce an action.

        Args:
            batch: As for `describe`, and `task`, which names the object.

        Returns:
            (batch, L, joints), scaled to [-1, 1] and held after the stop output.
        """
        self._begin("repeat_action")
        joints = recorded_joints(batch)
        features = self.visual.encode(
            batch, [parse_command(task).object for task in read_tasks(batch)]
        ).features
        prompts = [repeat_action_prompt()] * len(joints)
        return self.model.plan(prompts, features, joints, self.config.max_episode_steps)

    @torch.no_grad()
    def translate(self, sentences: Sequence[str], batch: dict[str, Any] | None = None) -> list[str]:
        """Translate English sentences into German.

        Args:
            sentences: One per sample.
            batch: May hold the robot's pose in `observation.state`, (batch, joints), scaled.
        """
        self._begin("translate")
        return self._answer([translate_prompt(sentence) for sentence in sentences], None, batch)

    def _answer(
        self, prompts: Sequence[str], features: Tensor | None, batch: dict[str, Any] | None
    ) -> list[str]:
        """What the robot says to prompts when it does not move; no features are zeros."""
        pose = self.rest_pose.expand(len(prompts), -1) if batch is None else first_pose(batch)
        if features is None:
            features = pose.new_zeros(len(pose), 1, self.config.dim_visual)
        return self.model.generate_text(prompts, features, still(pose))
