# SPDX-License-Identifier: Apache-2.0
"""Which of a dataset's cameras a policy looks through."""

from collections.abc import Sequence

from lerobot.utils.constants import OBS_IMAGES

DEFAULT_CAMERA = f"{OBS_IMAGES}.eyes"


def choose_camera(cameras: Sequence[str], named: str | None, policy_type: str) -> str:
    """Choose one camera: the named one, else `DEFAULT_CAMERA`, else the only one.

    Args:
        cameras: Keys of the dataset's image features.
        named: What `--policy.camera` says.
        policy_type: Name of the policy, for the message.

    Raises:
        ValueError: If there is no such camera, or none, or several and none is named.
    """
    if named is not None:
        if named not in cameras:
            raise ValueError(f"--policy.camera={named} is not among the dataset's cameras: {[*cameras]}.")
        return named
    if DEFAULT_CAMERA in cameras:
        return DEFAULT_CAMERA
    if len(cameras) != 1:
        raise ValueError(
            f"{policy_type} looks through one camera, and the dataset has {[*cameras] or 'none'}. "
            + ("Name one with --policy.camera." if cameras else "Choose a dataset with an image feature.")
        )
    return cameras[0]
