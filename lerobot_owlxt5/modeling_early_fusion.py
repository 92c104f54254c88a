# SPDX-License-Identifier: Apache-2.0
"""The policy early_fusion, a rival of OWLxT5: one network from image patches and words to joint tokens.

After RT-2 (Brohan et al., 2023), small and from random weights (docs/rivals.md).
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import torch
from lerobot.policies.pretrained import PreTrainedPolicy
from lerobot.utils.constants import ACTION, OBS_STATE
from torch import Tensor, nn

from .commands.prompts import (
    DESCRIBE,
    EXECUTE,
    MODES,
    TRANSLATE,
    check_texts,
    describe_prompt,
    execute_prompt,
    translate_prompt,
)
from .configuration_early_fusion import EarlyFusionConfig
from .data.episode_ends import EpisodeEnds
from .data.episode_store import EpisodeStore, EpisodeTexts
from .data.normalization import SMALLEST_RANGE, share_joint_range
from .losses import reduce_loss
from .mode_sampling import ModeBatch, ModeSampler, step_randomness
from .model.early_fusion_model import EarlyFusionModel
from .validation import check_finite_loss, check_state, read_tasks

if TYPE_CHECKING:
    from lerobot.datasets import LeRobotDatasetMetadata


class EarlyFusionPolicy(PreTrainedPolicy):
    """Looks, decodes a chunk of actions as tokens, carries it out, and looks again.

    Picture and command go in as they are: nothing is detected, nothing is understood, nothing is refused.

    Attributes:
        largest_displacement: How far a chunk's actions are from the pose at its beginning, at most in the
            training data, (joints,), scaled as the pose. The bins of a joint's displacements cover it.
    """

    config_class = EarlyFusionConfig
    name = "early_fusion"
    config: EarlyFusionConfig
    training_seed: Tensor
    largest_displacement: Tensor

    def __init__(
        self,
        config: EarlyFusionConfig,
        dataset_meta: "LeRobotDatasetMetadata | None" = None,
        **kwargs: Any,
    ) -> None:
        """Make the policy.

        Args:
            config: The configuration; its features are checked here.
            dataset_meta: The training data, if the policy is going to be trained. Its statistics get one
                range for state and action here, before LeRobot puts them into new or loaded processors.
            **kwargs: What LeRobot passes to all policies and this one has no use for.

        Raises:
            ValueError: If features are missing, or describe is to be learnt and the dataset's camera has
                another name.
        """
        super().__init__(config)
        config.validate_features()
        self.config = config
        n_joints = config.action_feature.shape[0]
        self.model = EarlyFusionModel(config, n_joints)
        self.register_buffer("largest_displacement", torch.ones(n_joints))
        # A resumed run equals an unbroken one: see `CrossmodalPolicy`.
        self.register_buffer("training_seed", torch.randint(2**31, ()))
        self._episodes: EpisodeStore | None = None
        if dataset_meta is not None:
            camera = config.camera_key
            if config.mode_probabilities.get("describe") and camera not in dataset_meta.camera_keys:
                raise ValueError(
                    f"early_fusion reads '{camera}' for describe from the dataset's files, which have "
                    f"{dataset_meta.camera_keys}: rename it in the dataset, not with --rename_map, or leave "
                    "describe out with --policy.mode_probabilities='{\"execute\": 1.0}'."
                )
            dataset_meta.stats.update(share_joint_range(dataset_meta.stats))
            self._episodes = EpisodeStore(dataset_meta)
            self._ends = EpisodeEnds(self._episodes.frames, camera, config.image_size)
        self.reset()

    @classmethod
    def from_pretrained(cls, *args: Any, strict: bool = True, **kwargs: Any) -> Self:
        """Load a checkpoint as LeRobot does, but refuse weights of another model: see `CrossmodalPolicy`."""
        return super().from_pretrained(*args, strict=strict, **kwargs)

    def get_optim_params(self) -> list[nn.Parameter]:
        """All parameters."""
        return [*self.parameters()]

    def reset(self) -> None:
        """Forget the chunk that is carried out."""
        self._queue: deque[Tensor] = deque()

    def drop_queued_actions(self) -> None:
        """Stop: the next `select_action` looks."""
        self.reset()

    # Training -----------------------------------------------------------------------------------------------

    def forward(self, batch: dict[str, Any], reduction: str = "mean") -> tuple[Tensor, dict[str, float]]:
        """Compute the cross entropy of a batch's tokens, each sample in a mode of its own.

        In training the modes are drawn; in evaluation they follow from the frame's index. Actions after an
        episode's end count too: they repeat the last one, so the arms learn to hold (our decision).

        Args:
            batch: The camera and `observation.state` at the drawn frame, `action` (batch, chunk_size,
                joints), and `task`, `episode_index` and `index`.
            reduction: `mean`, or `none` for the loss of each sample, (batch,).

        Returns:
            The loss, and its mean over the samples of each mode that was drawn, such as `execute_loss`.

        Raises:
            ValueError: If the policy was made without a dataset.
            FloatingPointError: If the loss is not finite.
        """
        sampler = ModeSampler(
            self.config.mode_probabilities, self._texts, names_objects=False, pseudo_names=False
        )
        read_tasks(batch)
        if self.training and self._episodes is not None:
            largest = self._episodes.largest_displacement(self.config.chunk_size)
            self.largest_displacement = largest.clamp(min=SMALLEST_RANGE).to(self.largest_displacement)
        with step_randomness(self.training_seed, batch["index"], enabled=self.training) as rngs:
            samples = sampler.sample(batch, rngs)
            loss = batch[ACTION].new_zeros(len(samples.mode))
            terms = dict[str, float]()
            # The samples of a mode are of one kind, and little work goes into padding.
            for mode in (EXECUTE, DESCRIBE, TRANSLATE):
                rows = (samples.mode == mode).nonzero().flatten().tolist()
                if rows:
                    losses = self._mode_loss(mode, rows, samples, batch)
                    terms[f"{MODES[mode]}_loss"] = losses.mean().item()
                    loss = loss.index_put((torch.tensor(rows, device=loss.device),), losses.to(loss))
        check_finite_loss(loss, batch)
        return reduce_loss(loss, reduction), terms

    def _mode_loss(self, mode: int, rows: list[int], samples: ModeBatch, batch: dict[str, Any]) -> Tensor:
        """Loss of the samples `rows`, which are in one mode, (rows,)."""
        prompts = [samples.prompts[row] for row in rows]
        if mode == EXECUTE:
            images, state = batch[self.config.camera_key][rows], batch[OBS_STATE][rows]
            embedded = self.model.embed(prompts, images[:, None], state)
            displacements = (batch[ACTION][rows] - state[:, None]) / self.largest_displacement
            return self.model.action_loss(*embedded, displacements)
        ends = None
        if mode == DESCRIBE:
            ends = self._ends.read(batch["episode_index"].flatten()[rows].tolist()).to(batch[ACTION].device)
        texts = [samples.targets[row] for row in rows]
        return self.model.text_loss(*self.model.embed(prompts, ends), texts)

    @cached_property
    def _texts(self) -> dict[int, EpisodeTexts]:
        """Of the training data; a sentence without a translation teaches nothing."""
        if self._episodes is None:
            raise ValueError(
                "Training needs the dataset: make the policy with `dataset_meta`, as LeRobot does."
            )
        return {
            episode: texts if texts.translation else replace(texts, sentence=None)
            for episode, texts in self._episodes.texts.items()
        }

    # The modes ----------------------------------------------------------------------------------------------

    @torch.no_grad()
    def select_action(self, batch: dict[str, Any], **kwargs: Any) -> Tensor:
        """Return the next action of the chunk; at its end look, and decode the next one.

        A new task counts from the next look on; `drop_queued_actions` brings it on.

        Args:
            batch: As for `predict_action_chunk`.
            **kwargs: Not used.

        Returns:
            (batch, joints), scaled as the state.
        """
        if not self._queue:
            self._queue.extend(self.predict_action_chunk(batch).unbind(dim=1))
        return self._queue.popleft()

    @torch.no_grad()
    def predict_action_chunk(self, batch: dict[str, Any], **kwargs: Any) -> Tensor:
        """Decode the actions that follow an observation.

        Args:
            batch: The camera (batch, 3, height, width) in [0, 1], `observation.state` (batch, joints) scaled,
                and `task`.
            **kwargs: Not used.

        Returns:
            (batch, chunk_size, joints), scaled as the state.

        Raises:
            ValueError: If there are other joints than in training, or a position is not finite, or a task is
                missing or too long.
        """
        self.eval()
        check_state(batch[OBS_STATE], self.config.action_feature.shape[0])
        prompts = [execute_prompt(task) for task in read_tasks(batch)]
        images, state = batch[self.config.camera_key][:, None], batch[OBS_STATE]
        displacements = self.model.generate_actions(*self.model.embed(prompts, images, state))
        return state[:, None] + displacements * self.largest_displacement

    @torch.no_grad()
    def describe(self, batch: dict[str, Any]) -> list[str]:
        """Say what was done.

        Args:
            batch: The camera's frames of finished episodes, (batch, frames, 3, height, width) in [0, 1]; the
                first one and the last one count.

        Returns:
            One description for each episode.
        """
        self.eval()
        images = batch[self.config.camera_key][:, [0, -1]]
        return self._answer([describe_prompt()] * len(images), images)

    @torch.no_grad()
    def translate(self, sentences: Sequence[str]) -> list[str]:
        """Translate English sentences into German.

        Raises:
            ValueError: If a sentence is too long.
        """
        self.eval()
        check_texts(sentences, "`sentences`")
        return self._answer([translate_prompt(sentence) for sentence in sentences])

    def _answer(self, prompts: Sequence[str], images: Tensor | None = None) -> list[str]:
        embedded = self.model.embed(prompts, images)
        return self.model.generate_text(*embedded, self.config.max_text_tokens)
