# SPDX-License-Identifier: Apache-2.0
"""Configuration of the policy early_fusion."""

from dataclasses import dataclass, field
from typing import ClassVar

from lerobot.configs import FeatureType, NormalizationMode, PolicyFeature, PreTrainedConfig
from lerobot.optim import AdamWConfig, CosineDecayWithWarmupSchedulerConfig
from lerobot.utils.constants import OBS_STATE

from .camera import choose_camera
from .joint_features import check_joint_features


@PreTrainedConfig.register_subclass("early_fusion")
@dataclass
class EarlyFusionConfig(PreTrainedConfig):
    """Configuration of early_fusion: one T5 from image patches and words to words or joint tokens.

    The sizes are our decision: one CPU core is to decode a chunk in about the time that it moves the robot.

    Args:
        camera: Image feature to look at. None: `observation.images.eyes`, or the only camera.
        image_size: Height and width that images are resized to, pixels.
        patch_size: Height and width of a patch, pixels; divides `image_size`.
        chunk_size: Actions that one look decides on; then it looks again.
        dim_model: Width of encoder and decoder.
        n_heads: Attention heads of each layer.
        dim_feedforward: Width of the feed-forward layers.
        n_encoder_layers: Layers of the encoder.
        n_decoder_layers: Layers of the decoder.
        dropout: Dropout of all layers.
        mode_probabilities: How often each mode is drawn in training. An episode without a sentence and its
            translation is never in translate; the other modes take its share.
        max_text_tokens: Longest text that `describe` and `translate` generate, in tokens.
        tokenizer_revision: Which embedded language model the tokenizer is of; filled in when the policy is
            made.
        optimizer_lr: Highest learning rate of AdamW.

    Attributes:
        modes: What the policy can do, out of `commands.prompts.MODES`.
    """

    modes: ClassVar[tuple[str, ...]] = ("execute", "describe", "translate")

    normalization_mapping: dict[str, NormalizationMode] = field(
        default_factory=lambda: {
            "VISUAL": NormalizationMode.IDENTITY,
            "STATE": NormalizationMode.MIN_MAX,
            "ACTION": NormalizationMode.MIN_MAX,
        }
    )

    # Architecture.
    camera: str | None = None
    image_size: tuple[int, int] = (112, 160)
    patch_size: int = 16
    chunk_size: int = 5
    dim_model: int = 256
    n_heads: int = 4
    dim_feedforward: int = 512
    n_encoder_layers: int = 3
    n_decoder_layers: int = 3
    dropout: float = 0.1

    # Training and generation.
    mode_probabilities: dict[str, float] = field(
        default_factory=lambda: {"execute": 0.7, "describe": 0.2, "translate": 0.1}
    )
    max_text_tokens: int = 128
    tokenizer_revision: str | None = None
    optimizer_lr: float = 1e-3

    def __post_init__(self) -> None:
        super().__post_init__()
        shares = self.mode_probabilities
        if unknown := sorted(set(shares) - set(self.modes)):
            raise ValueError(
                f"--policy.mode_probabilities names unknown modes {unknown}; {self.type} has {self.modes}."
            )
        if min(shares.values(), default=0) < 0 or not shares.get("execute", 0) + shares.get("describe", 0):
            raise ValueError(
                "--policy.mode_probabilities must not be negative, and execute or describe must be above 0 "
                f"(not every dataset can be translated); it is {shares}."
            )
        if self.patch_size < 1 or any(side % self.patch_size for side in self.image_size):
            raise ValueError(
                f"--policy.image_size={list(self.image_size)} must be multiples of "
                f"--policy.patch_size={self.patch_size}."
            )
        if self.chunk_size < 1:
            raise ValueError(f"--policy.chunk_size must be at least 1, not {self.chunk_size}.")
        if self.dim_model % self.n_heads:
            raise ValueError(
                f"--policy.dim_model={self.dim_model} must be a multiple of --policy.n_heads={self.n_heads}."
            )

    def validate_features(self) -> None:
        """Check the dataset's features and keep the two that the policy may see: one camera and the state.

        Raises:
            ValueError: If the camera, the state or the action is missing, or state and action differ in size.
        """
        check_joint_features(self)
        inputs: dict[str, PolicyFeature] = self.input_features or {}  # type: ignore[has-type]
        cameras = [key for key, feature in inputs.items() if feature.type is FeatureType.VISUAL]
        camera = choose_camera(cameras, self.camera, self.type)
        self.input_features = {key: inputs[key] for key in (camera, OBS_STATE)}

    @property
    def camera_key(self) -> str:
        """The one camera that is left after `validate_features`."""
        return next(iter(self.image_features))

    def get_optimizer_preset(self) -> AdamWConfig:
        """AdamW (our decision)."""
        return AdamWConfig(lr=self.optimizer_lr, grad_clip_norm=1.0)

    def get_scheduler_preset(self) -> CosineDecayWithWarmupSchedulerConfig:
        """Warm-up and cosine decay over the whole training, as LeRobot scales it (our decision)."""
        return CosineDecayWithWarmupSchedulerConfig(
            num_warmup_steps=2000,
            num_decay_steps=100_000,
            peak_lr=self.optimizer_lr,
            decay_lr=self.optimizer_lr / 10,
        )

    @property
    def observation_delta_indices(self) -> None:
        """The drawn frame itself, without a time axis."""
        return None

    @property
    def action_delta_indices(self) -> list[int]:
        """The chunk that begins at the drawn frame; LeRobot repeats the last action after the end."""
        return list(range(self.chunk_size))

    @property
    def reward_delta_indices(self) -> None:
        """No rewards."""
        return None
