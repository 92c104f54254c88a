# SPDX-License-Identifier: Apache-2.0
"""How much the world may differ from the paper's setting at each reset, and one draw of such differences."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .placement import Pose, Poses
from .robot import INITIAL_POSE_DEG, joint_limits_deg
from .tasks import SLOTS

_BRIGHTEST = 1.5
"""More light than this would make white of all that is bright."""
_BEST_JPEG = 95
"""Beyond this quality a JPEG file grows and shows no difference."""
_WOOD = np.array([0.7, 0.58, 0.44])
"""Mean colour of the table's own wood, the mildest that is drawn."""
_TINT = 0.08
_DIGITS = 3  # of what is drawn: a scene's facts stay short and still give the very scene

_LARGEST = {
    "arms_deg": 45.0,
    "shift_cm": 6.0,
    "camera_cm": 10.0,
    "camera_deg": 20.0,
    "noise": 64.0,
    "blur": 10.0,
}
"""A movement shifts an object by 6 cm; beyond the others, little is to be made out."""


@dataclass(frozen=True)
class Conditions:
    """One concrete difference from the paper's setting; without arguments there is none.

    Attributes:
        arms_deg: Added to each joint's initial angle, ten degrees in the order of `robot.JOINT_NAMES`.
        shift_cm: Added to the place (x, y) of the left, middle and right object, robot's frame, centimetres.
        camera_cm: How far the eyes' camera moves to the image's right, upwards and backwards, centimetres.
        camera_deg: How far it turns about these three axes, one after the other, degrees. Turns to the
            right-handed side: up, to the left, and counterclockwise as seen from behind it.
        light: Factor of all lights.
        table: Colour of the table top, red, green and blue from 0 to 1; None: its own wood.
        noise: Standard deviation of the noise of the eyes' pixels, grey levels of 255.
        blur: Standard deviation of the Gaussian that blurs the eyes' image, pixels.
        jpeg: Quality with which the eyes' image is compressed as JPEG, 1 to 95; 0: not at all.
        seed: Of the noise. The same seed gives each step's image the same noise.

    Raises:
        ValueError: If a value has another length than these, or lies out of range.
    """

    arms_deg: tuple[float, ...] = (0.0,) * len(INITIAL_POSE_DEG)
    shift_cm: tuple[tuple[float, float], ...] = ((0.0, 0.0),) * len(SLOTS)
    camera_cm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    camera_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    light: float = 1.0
    table: tuple[float, float, float] | None = None
    noise: float = 0.0
    blur: float = 0.0
    jpeg: int = 0
    seed: int = 0

    def __post_init__(self) -> None:
        shapes = {"arms_deg": (len(INITIAL_POSE_DEG),), "shift_cm": (len(SLOTS), 2)}
        shapes |= {"camera_cm": (3,), "camera_deg": (3,)} | ({} if self.table is None else {"table": (3,)})
        for name, shape in shapes.items():
            if np.shape(getattr(self, name)) != shape:
                size = " x ".join(map(str, shape))
                raise ValueError(f"conditions: {name} has {size} numbers; got {getattr(self, name)}")
        if self.light < 0 or self.noise < 0 or self.blur < 0:
            raise ValueError(f"conditions: light, noise and blur must not be negative; got {self}")
        if not 0 <= self.jpeg <= _BEST_JPEG:
            raise ValueError(f"conditions: jpeg is a quality from 1 to {_BEST_JPEG}, or 0; got {self.jpeg}")

    @property
    def start_pose_deg(self) -> NDArray[np.float64]:
        """Where the arms start, float64 (10,), degrees, within the joint limits.

        The initial pose stays as it is, though it lies 0.02 degrees beyond the elbows' limits.
        """
        low, high = joint_limits_deg().T
        pose = INITIAL_POSE_DEG + np.array(self.arms_deg)
        return np.clip(pose, np.minimum(low, INITIAL_POSE_DEG), np.maximum(high, INITIAL_POSE_DEG))

    def shifted(self, poses: Sequence[Pose]) -> Poses:
        """Where objects stand that were placed at `poses`.

        Raises:
            ValueError: If there are not three.
        """
        if len(poses) != len(self.shift_cm):
            raise ValueError(f"each of the three objects needs a pose; got {len(poses)} poses")
        left, middle, right = (
            Pose(pose.x + x / 100, pose.y + y / 100, pose.yaw)
            for pose, (x, y) in zip(poses, self.shift_cm, strict=True)
        )
        return left, middle, right

    def facts(self) -> dict[str, Any]:
        """What differs from the paper's setting, by attribute, as JSON has it."""
        return {name: value for name, value in asdict(self).items() if value != getattr(_NONE, name)}


_NONE = Conditions()


@dataclass(frozen=True)
class Variation:
    """The largest difference from the paper's setting that a reset may draw; without arguments none.

    All of it is our decision.

    Attributes:
        arms_deg: Each joint of the arms starts off its initial angle by up to so many degrees, uniformly and
            within its limits.
        shift_cm: Each object stands off its place by up to so many centimetres, in any direction.
        camera_cm: The eyes' camera is moved by up to so many centimetres, in any direction.
        camera_deg: The eyes' camera is turned about each of its axes by up to so many degrees.
        light: Factor of all lights at the darkest, above 0 and up to 1, drawn uniformly in its logarithm. At
            the brightest it is 1/light, at most 1.5.
        table: The table top has a colour of its own, from its wood's to white.
        noise: The eyes' pixels have noise of a standard deviation of up to so many grey levels of 255.
        blur: The eyes' image is blurred by a Gaussian of a standard deviation of up to so many pixels.
        jpeg: The eyes' image is compressed as JPEG, with this quality, 1 to 95, or a better one; 0: never.

    Raises:
        ValueError: If a value lies out of range; the message names it.
    """

    arms_deg: float = 0.0
    shift_cm: float = 0.0
    camera_cm: float = 0.0
    camera_deg: float = 0.0
    light: float = 1.0
    table: bool = False
    noise: float = 0.0
    blur: float = 0.0
    jpeg: int = 0

    def __post_init__(self) -> None:
        for name, most in _LARGEST.items():
            if not 0 <= (value := getattr(self, name)) <= most:
                raise ValueError(f"variation.{name} must lie between 0 and {most:g}; got {value}")
        if not 0 < self.light <= 1:
            raise ValueError(f"variation.light must lie above 0 and not above 1; got {self.light}")
        if not 0 <= self.jpeg <= _BEST_JPEG:
            raise ValueError(f"variation.jpeg must lie between 0 and {_BEST_JPEG}; got {self.jpeg}")

    def options(self) -> dict[str, float | int | bool]:
        """What is on: the value of each attribute that is not off."""
        return {field.name: getattr(self, field.name) for field in fields(self) if self._is_on(field.name)}

    def _is_on(self, name: str) -> bool:
        return bool(getattr(self, name) != getattr(type(self), name))

    def draw(self, random: np.random.Generator) -> Conditions:
        """Draw conditions, uniformly where nothing else is said.

        Each attribute takes the same random numbers whatever else is on: the arms that a seed draws stay the
        same when the light varies too.
        """
        arms = random.uniform(-1, 1, len(INITIAL_POSE_DEG)) * self.arms_deg
        angle = random.uniform(0, 2 * np.pi, len(SLOTS))
        distance = random.uniform(0, 1, len(SLOTS)) * self.shift_cm
        shift = (distance * [np.cos(angle), np.sin(angle)]).T
        direction = random.normal(size=3)
        camera = direction / np.linalg.norm(direction) * random.uniform(0, 1) * self.camera_cm
        turn = random.uniform(-1, 1, 3) * self.camera_deg
        brightest = min(1 / self.light, _BRIGHTEST)
        light = self.light * (brightest / self.light) ** random.uniform(0, 1)
        white, tint = random.uniform(0, 1), random.uniform(-_TINT, _TINT, 3)
        colour = np.clip(_WOOD + white * (1 - _WOOD) + (1 - white) * tint, 0, 1)
        noise, blur, quality = random.uniform(0, 1, 3) * [self.noise, self.blur, _BEST_JPEG - self.jpeg]
        seed = int(random.integers(2**31))
        return Conditions(
            _rounded(arms),
            tuple(map(_rounded, shift)),
            _rounded(camera),
            _rounded(turn),
            round(float(light), _DIGITS),
            _rounded(colour) if self.table else None,
            round(float(noise), _DIGITS),
            round(float(blur), _DIGITS),
            self.jpeg + round(float(quality)) if self.jpeg else 0,
            seed if self.noise else 0,
        )


def _rounded(values: NDArray[np.float64]) -> Any:
    return tuple((np.round(values, _DIGITS) + 0.0).tolist())  # turns -0.0 into 0.0
