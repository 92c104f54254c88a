# SPDX-License-Identifier: Apache-2.0
"""The trained policy that is part of this package, and `owlxt5-policy`, which prints its folder.

`owlxt5_policy.ship` puts it there.
"""

import sys
from importlib.resources import files
from pathlib import Path

FOLDER = Path(str(files(__package__))) / "owlxt5"
"""Where the policy lies: a LeRobot checkpoint, `--policy.path`."""


def is_there(folder: Path = FOLDER) -> bool:
    """Whether this package came with weights; `folder` is where they should be."""
    return (folder / "model.safetensors").is_file()


def find_policy(folder: Path = FOLDER) -> Path:
    """The folder of the policy.

    Args:
        folder: Where it should be.

    Raises:
        FileNotFoundError: If this package came without weights.
    """
    if not is_there(folder):
        raise FileNotFoundError(
            "This version of lerobot_policy_owlxt5 has no trained policy: train one with lerobot-train, "
            "as the README shows, and name its folder with --policy.path."
        )
    return folder


def main() -> None:
    """Print the folder, for `lerobot-eval --policy.path="$(owlxt5-policy)"`."""
    try:
        print(find_policy())
    except FileNotFoundError as error:
        sys.exit(f"owlxt5-policy: {error}")
