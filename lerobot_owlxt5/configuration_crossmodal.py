# SPDX-License-Identifier: Apache-2.0
"""What the configurations of OWLxT5 and CrossT5 have in common."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from lerobot.configs import FeatureType, NormalizationMode, PolicyFeature, PreTrainedConfig
from lerobot.optim import AdamConfig
from lerobot.utils.constants import ACTION, OBS_STATE

from .backbones.pretrained import EMBEDDED
from .camera import choose_camera
from .commands.prompts import MODES
from .joint_features import check_joint_features

CORE_VERSION = 2
"""What the core's parameters mean. Version 1, which no configuration names, had no ReLU and norm on keys."""


NO_UNDERSTANDING = "none"
"""In place of a model's name: words go to the language model as they are."""


def _default_normalization() -> dict[str, NormalizationMode]:
    return {
        "VISUAL": NormalizationMode.IDENTITY,
        "STATE": NormalizationMode.MIN_MAX,
        "ACTION": NormalizationMode.MIN_MAX,
    }


def _default_mode_probabilities() -> dict[str, float]:
    return {"execute": 0.3, "describe": 0.3, "repeat_action": 0.3, "translate": 0.1}


@dataclass
class CrossmodalConfig(PreTrainedConfig):
    """A split T5, a crossmodal Transformer and an LSTM action path; what it sees is the subclass's.

    The defaults are the paper's sizes. The policy plans a whole episode from its first frame, so the
    dataset's episodes must not be longer than `max_episode_steps`.

    Args:
        language_model: T5 to split: Hub id, folder (weights as safetensors), or `embedded`, the small one in
            this package.
        language_model_revision: Hub revision of the language model; None is its main branch.
        understanding: T5 that has learnt what people ask for: Hub id, folder, `embedded`, or `none`: then the
            words go to language model and detector as they are, as in the paper. It is not trained here, and
            a checkpoint only names it.
        understanding_revision: Hub revision of it; None is its main branch.
        train_language_model: Train T5 along and store its weights in the checkpoint. By default it stays
            frozen and a checkpoint only names it.
        camera: Image feature to look at. None: `observation.images.eyes`, or the only camera.
        max_episode_steps: Longest episode L in steps, in training and as a plan.
        dim_model: Width of the crossmodal Transformer.
        n_heads: Attention heads of the crossmodal Transformer.
        dim_feedforward: Width of its feed-forward layer.
        dropout: Dropout of its layer.
        dim_lstm: Units of the action LSTMs, per direction.
        n_lstm_layers: Layers of the action encoder and of the action decoder.
        mode_probabilities: How often each mode is drawn in training. A mode that the dataset has no text for
            (translate) gives its share to the others.
        mode_per_sample: Draw a mode for each sample of a training batch. False: one for the whole batch.
        made_up_names: In training some objects get a made-up name, if T5 is small or trained along (our
            addition, `commands.pseudo_names`). False: never.
        stop_output: Learn when a movement ends (our addition). False: a plan has all of
            `max_episode_steps`, and nothing tells what comes after the steps of its episode.
        joint_loss_weight: Weight of the action path's loss beside the language loss; 1 in the paper.
        max_text_tokens: Longest text that `describe` and `translate` generate, in tokens.
        replan_every: While a hand approaches, look again every so many steps, and change the plan if
            the thing is elsewhere now. 0: never. Only a policy with a detector can.
        tasks: Task texts of the training data; filled in as training meets them, on several GPUs as the first
            one does. They name the objects that `describe` looks for, and the tasks that the policy knows
            beside its own verbs.
        trained_modes: Modes that training has drawn; filled in by training. None: not known, as in a
            checkpoint from before they were noted.
        core_version: `CORE_VERSION` of the package that made the policy; filled in when it is made.
        optimizer_lr: Learning rate of Adam.

    Attributes:
        dim_visual: Numbers that a frame is turned into.
        modes: What the policy can do, out of `MODES`.
    """

    dim_visual: ClassVar[int]
    modes: ClassVar[tuple[str, ...]] = MODES

    normalization_mapping: dict[str, NormalizationMode] = field(default_factory=_default_normalization)

    # Backbones.
    language_model: str = "google-t5/t5-small"
    language_model_revision: str | None = None
    train_language_model: bool = False
    understanding: str = EMBEDDED
    understanding_revision: str | None = None
    camera: str | None = None

    # Architecture.
    max_episode_steps: int = 85
    dim_model: int = 512
    n_heads: int = 4
    dim_feedforward: int = 1024
    dropout: float = 0.25
    dim_lstm: int = 256
    n_lstm_layers: int = 2

    # Training and generation.
    mode_probabilities: dict[str, float] = field(default_factory=_default_mode_probabilities)
    mode_per_sample: bool = True
    made_up_names: bool = True
    stop_output: bool = True
    joint_loss_weight: float = 1.0
    max_text_tokens: int = 128
    replan_every: int = 0
    tasks: list[str] | None = None
    trained_modes: list[str] | None = None
    core_version: int | None = None
    optimizer_lr: float = 1e-5

    def __post_init__(self) -> None:
        super().__post_init__()
        unknown = set(self.mode_probabilities) - set(self.modes)
        if unknown:
            raise ValueError(
                f"--policy.mode_probabilities names unknown modes {sorted(unknown)}; {self.type} has "
                f"{self.modes}."
            )
        shares = self.mode_probabilities.values()
        if any(share < 0 for share in shares) or not any(
            share > 0 for mode, share in self.mode_probabilities.items() if mode != "translate"
        ):
            raise ValueError(
                "--policy.mode_probabilities must not be negative, and at least one mode besides translate "
                f"must be above 0 (not every dataset can be translated); it is {self.mode_probabilities}."
            )
        if self.joint_loss_weight <= 0:
            raise ValueError(f"--policy.joint_loss_weight must be above 0, not {self.joint_loss_weight}.")
        if self.max_episode_steps < 1:
            raise ValueError(f"--policy.max_episode_steps must be at least 1, not {self.max_episode_steps}.")
        if self.replan_every < 0:
            raise ValueError(
                f"--policy.replan_every must be 0 (never) or more steps, not {self.replan_every}."
            )
        if self.dim_model % self.n_heads or self.dim_model % 2:
            raise ValueError(
                f"--policy.dim_model={self.dim_model} must be even, and a multiple of --policy.n_heads="
                f"{self.n_heads}."
            )

    def validate_features(self) -> None:
        """Check the dataset's features and keep the two that the policy may see: one camera and the state.

        Dropping the others here keeps them out of the normaliser as well, so that privileged features such as
        `observation.objects` reach the ground truth detector as they are.

        Raises:
            ValueError: If the camera, the state or the action is missing, or state and action differ in size.
        """
        inputs: dict[str, PolicyFeature] = self.input_features or {}  # type: ignore[has-type]
        check_joint_features(self)
        cameras = [key for key, feature in inputs.items() if feature.type is FeatureType.VISUAL]
        seen = [] if self.can_be_blind and not cameras else [choose_camera(cameras, self.camera, self.type)]
        self.input_features = {key: inputs[key] for key in (*seen, OBS_STATE)}

    def check_core_version(self, checkpoint: str) -> None:
        """Check that a checkpoint's parameters mean what this package takes them for.

        Args:
            checkpoint: Where this configuration comes from, for the message.

        Raises:
            ValueError: If it was made before the core's equations changed.
        """
        if self.core_version != CORE_VERSION:
            raise ValueError(
                f"{checkpoint} was made by another version of lerobot_policy_owlxt5, whose core computes "
                f"something else with the same parameters (core_version {self.core_version or 1}, here "
                f"{CORE_VERSION}): train it again."
            )

    def note_modes(self, drawn: Sequence[int]) -> None:
        """Note modes that a training batch is in, indices into `MODES`."""
        known = {MODES[mode] for mode in drawn}.union(self.trained_modes or ())
        self.trained_modes = [mode for mode in MODES if mode in known]

    def was_trained_in(self, mode: str) -> bool:
        """Whether training has drawn a mode, one of `MODES`; also true where nobody noted it."""
        return self.trained_modes is None or mode in self.trained_modes

    def check_mode(self, mode: str) -> None:
        """Check that the policy has learnt a mode before it is asked for it.

        Raises:
            ValueError: If it was never trained in the mode.
        """
        if not self.was_trained_in(mode):
            raise ValueError(
                f"This policy was never trained in the mode '{mode}', only in {self.trained_modes}. Train it "
                "with a share for it in --policy.mode_probabilities"
                + (", on data with sentences to translate." if mode == "translate" else ".")
            )

    def check_dataset(self, features: dict[str, Any]) -> None:
        """Check that a dataset has what the policy reads: a checkpoint may go on with another one.

        Args:
            features: Of the dataset, as in its `meta/info.json`.

        Raises:
            ValueError: If it lacks the joints under these names or has others, or the policy needs a camera
                and it has none.
        """
        size = self.action_feature.shape
        for key in (OBS_STATE, ACTION):
            if key not in features:
                raise ValueError(
                    f"{self.type} reads '{key}' from the dataset's files, where it has another name or is "
                    "missing. --rename_map can rename cameras alone; rename this feature in the dataset."
                )
            if tuple(features[key]["shape"]) != size:
                raise ValueError(
                    f"The policy was made for {size[0]} joints, but '{key}' of the dataset has the shape "
                    f"{tuple(features[key]['shape'])}. Choose a dataset of the same robot."
                )
        if not self.can_be_blind and not any(ft["dtype"] in ("image", "video") for ft in features.values()):
            raise ValueError(f"{self.type} looks through '{self.camera_key}', but the dataset has no camera.")

    @property
    def backbones(self) -> dict[str, tuple[str, str | None]]:
        """Name and revision of the pretrained models, by the option that names them."""
        named = {"language_model": (self.language_model, self.language_model_revision)}
        if self.understanding != NO_UNDERSTANDING:
            named["understanding"] = (self.understanding, self.understanding_revision)
        return named

    @property
    def camera_key(self) -> str:
        """The one camera that is left after `validate_features`."""
        return next(iter(self.image_features))

    @property
    def can_be_blind(self) -> bool:
        """Whether a dataset without any camera will do."""
        return False

    def get_optimizer_preset(self) -> AdamConfig:
        """Adam, as in the paper (section 3)."""
        return AdamConfig(lr=self.optimizer_lr)

    def get_scheduler_preset(self) -> None:
        """The learning rate stays constant."""

    @property
    def observation_delta_indices(self) -> list[int]:
        """Always the episode's first frame: LeRobot clamps an index that leaves the episode."""
        return [1 - self.max_episode_steps]

    @property
    def describe_delta_indices(self) -> list[int]:
        """Frames of a finished episode that `describe` and `repeat_action` see: first and last."""
        return [1 - self.max_episode_steps, self.max_episode_steps - 1]

    @property
    def action_delta_indices(self) -> None:
        """Training reads whole episodes itself, see `data.episode_store`."""
        return None

    @property
    def episode_delta_indices(self) -> list[int]:
        """A window that covers all of an episode, whatever frame was drawn."""
        return list(range(1 - self.max_episode_steps, self.max_episode_steps))

    @property
    def reward_delta_indices(self) -> None:
        """No rewards."""
        return None
