# SPDX-License-Identifier: Apache-2.0
"""What the policies OWLxT5 and CrossT5 have in common: all but what they see."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import torch
from lerobot.configs import PreTrainedConfig
from torch import Tensor, nn

from .backbones.pretrained import EMBEDDED, check_backbones
from .commands.parser import named_objects, parse_command, plain
from .commands.prompts import check_texts, describe_prompt, repeat_action_prompt, translate_prompt
from .configuration_crossmodal import CORE_VERSION, CrossmodalConfig
from .data.episode_store import EpisodeStore
from .data.normalization import share_joint_range
from .data.windows import first_pose, recorded_joints, still
from .executing_policy import ExecutingPolicy
from .losses import STOP_LOSS_WEIGHT, mixed_loss, reduce_loss
from .mode_sampling import ModeSampler, step_randomness
from .model.crossmodal_model import CrossmodalModel
from .validation import check_finite_loss, read_tasks

if TYPE_CHECKING:
    from lerobot.datasets import LeRobotDatasetMetadata


class CrossmodalPolicy(ExecutingPolicy):
    """Executes, describes and repeats actions, repeats language and translates.

    A visual encoder, which a subclass makes, turns images into numbers. The model joins them with prompt and
    joints, and answers with a text and a movement.
    """

    # LeRobot asks both of each class, of this unfinished one too.
    config_class = CrossmodalConfig
    name = "crossmodal"
    training_seed: Tensor

    def __init__(
        self,
        config: CrossmodalConfig,
        dataset_meta: "LeRobotDatasetMetadata | None" = None,
        **kwargs: Any,
    ) -> None:
        """Make the policy.

        Args:
            config: The configuration; its features are checked here.
            dataset_meta: The training data, if the policy is going to be trained. Its statistics get one
                range for state and action here, before LeRobot puts them into new or loaded processors.
            **kwargs: What LeRobot passes to all policies and this one has no use for.
        """
        super().__init__(config)
        config.validate_features()
        if dataset_meta is not None:
            config.check_dataset(dataset_meta.features)
        check_backbones(config.backbones)
        config.core_version = CORE_VERSION
        self.config: CrossmodalConfig = config
        self.episodes: EpisodeStore | None = None
        if dataset_meta is not None:
            dataset_meta.stats.update(share_joint_range(dataset_meta.stats))
            self.episodes = EpisodeStore(dataset_meta)
            self.episodes.warn_of_long(config.max_episode_steps)
            check_texts([*dataset_meta.tasks.index], "A task of the dataset")
        n_joints = config.action_feature.shape[0]
        self.model = CrossmodalModel(config, n_joints)
        # LeRobot restores the global generator when a run is resumed, but its data loader then draws from it
        # before the first step. With a seed of its own in the checkpoint, a resumed run equals an unbroken
        # one.
        self.register_buffer("training_seed", torch.randint(2**31, ()))
        self.register_rest_pose(n_joints)
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
            ValueError: If it holds another policy, or its parameters mean something else in this version.
        """
        if config is None:
            config = PreTrainedConfig.from_pretrained(pretrained_name_or_path, **kwargs)
        if not isinstance(config, cls.config_class):
            raise ValueError(
                f"{pretrained_name_or_path} holds the policy '{config.type}', not '{cls.name}': load it with "
                "the class of that policy."
            )
        config.check_core_version(str(pretrained_name_or_path))
        return super().from_pretrained(pretrained_name_or_path, config=config, strict=strict, **kwargs)

    def get_optim_params(self) -> list[nn.Parameter]:
        """All parameters that learn: the core, and T5 if it is trained along."""
        return [parameter for parameter in self.parameters() if parameter.requires_grad]

    def _get_default_peft_targets(self) -> dict[str, Any]:
        """Adapt all linear layers, and T5's queries and values if it is trained along; LoRA knows no LSTM."""
        core = r"core\.(crossmodal\.(queries|keys|feedforward\.[03])|fc|decoder\.(initial|joints|stop))"
        return {"target_modules": rf"model\.({core}|language_model\..*\.[qv])", "modules_to_save": []}

    # Training -----------------------------------------------------------------------------------------------

    def forward(self, batch: dict[str, Any], reduction: str = "mean") -> tuple[Tensor, dict[str, float]]:
        """Compute the mixed loss (paper, section 3; `losses`) of a batch, each sample in a mode of its own.

        In training the modes are drawn; in evaluation they follow from the frame's index.

        Args:
            batch: `observation.state` and the camera at the episode's first frame, `action` at any frame, and
                `task`, `episode_index` and `index`.
            reduction: `mean`, or `none` for the loss of each sample, (batch,): --sample_weighting asks so.

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
            pseudo_names=self.config.made_up_names
            and (self.config.train_language_model or self.config.language_model == EMBEDDED),
            per_sample=self.config.mode_per_sample,
        )
        with step_randomness(self.training_seed, batch["index"], enabled=self.training) as rngs:
            if self.training:
                self.rest_pose = self.episodes.initial_pose.to(self.rest_pose)
                self.rest_tolerance = self.episodes.initial_tolerance.to(self.rest_tolerance)
            actions, length = self.episodes.actions(batch, self.config.max_episode_steps)
            tasks = read_tasks(batch)
            if self.training:
                self.config.tasks = list(dict.fromkeys([*(self.config.tasks or []), *filter(plain, tasks)]))
            names = [parse_command(task).object for task in tasks]
            seen = self.visual.encode_cached(batch, names, self.episodes)
            modes = sampler.sample(batch, rngs)
            if self.training:
                self.config.note_modes(modes.mode.tolist())
            terms = mixed_loss(
                self.model,
                modes,
                seen.features,
                first_pose(batch),
                actions,
                length,
                mean_length=self.episodes.mean_length(self.config.max_episode_steps),
                joint_loss_weight=self.config.joint_loss_weight,
                stop_loss_weight=STOP_LOSS_WEIGHT if self.config.stop_output else 0.0,
            )
        check_finite_loss(terms.loss, batch)
        found = seen.object_found.float().mean().item()
        return reduce_loss(terms.loss, reduction), terms.means() | {"found": found}

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
            One description per sample, `NOTHING_MOVED` or `NOTHING_KNOWN` (`commands.replies`).

        Raises:
            ValueError: If a label is too long, or there is none.
        """
        self._begin("describe")
        if labels is None:
            labels = named_objects(self.config.tasks or [])
        else:
            check_texts(labels, "`labels`")
            for label in labels if self.visual.names_objects else ():
                if not self.visual.can_read([label]):
                    raise ValueError(f"The detector cannot look for a name as long as {label!r}: shorten it.")
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
        names = [parse_command(task).object for task in read_tasks(batch)]
        features = self.visual.encode(batch, names).features
        prompts = [repeat_action_prompt()] * len(joints)
        return self.model.plan(prompts, features, joints, self.config.max_episode_steps)

    @torch.no_grad()
    def translate(self, sentences: Sequence[str], batch: dict[str, Any] | None = None) -> list[str]:
        """Translate English sentences into German.

        Args:
            sentences: One per sample.
            batch: May hold the robot's pose in `observation.state`, (batch, joints), scaled.

        Raises:
            ValueError: If a sentence is too long.
        """
        self._begin("translate")
        check_texts(sentences, "`sentences`")
        return self._answer([translate_prompt(sentence) for sentence in sentences], None, batch)

    def _answer(
        self, prompts: Sequence[str], features: Tensor | None, batch: dict[str, Any] | None
    ) -> list[str]:
        """What the robot says to prompts when it does not move; no features are zeros."""
        pose = self.rest_pose.expand(len(prompts), -1) if batch is None else first_pose(batch)
        if features is None:
            features = pose.new_zeros(len(pose), 1, self.config.dim_visual)
        return self.model.generate_text(prompts, features, still(pose))
