# SPDX-License-Identifier: Apache-2.0
"""A calibrated camera over a table: a point of the image in, a place on the table out."""

from dataclasses import dataclass
from math import cos, radians, sin, tan

import torch
from torch import Tensor


@dataclass(frozen=True)
class TableView:
    """A pinhole camera that is not tilted sideways and looks forward and down on a level table.

    Attributes:
        place: Of the camera: x forward and y to the robot's left in the robot's frame, and its height over
            the table, metres.
        tilt_deg: How far it looks down, from the horizon, degrees.
        fovy_deg: Its vertical field of view, degrees.
        aspect: Width over height of its image.
    """

    place: tuple[float, float, float]
    tilt_deg: float
    fovy_deg: float
    aspect: float

    @property
    def nadir(self) -> float:
        """Row straight below the camera, as a share of the image's height; see `Detections.foot`."""
        return 0.5 + 0.5 / tan(radians(self.tilt_deg)) / tan(radians(self.fovy_deg) / 2)

    def table_places(self, foot: Tensor, depth: float) -> Tensor:
        """Where objects stand whose boxes have their feet at points of the image.

        A box's lower edge belongs to the side of the object that is nearest to the camera. The middle lies
        behind it in the vertical plane through camera and object.

        Args:
            foot: (..., 2), scaled to [-1, 1] from the image's upper left corner.
            depth: How far an object's middle lies in front (+x) of its near side, metres.

        Returns:
            Places (..., 2), x and y in the robot's frame, metres; over the horizon they are far away.
        """
        half = tan(radians(self.fovy_deg) / 2)
        down, forward = sin(radians(self.tilt_deg)), cos(radians(self.tilt_deg))
        right, up = foot[..., 0] * self.aspect * half, -foot[..., 1] * half
        fall = down - up * forward
        reach = self.place[2] / fall.clamp(min=1e-6)
        x, y = reach * (forward + up * down), -reach * right
        beyond = 1 + depth / x
        return torch.stack([self.place[0] + beyond * x, self.place[1] + beyond * y], dim=-1)
