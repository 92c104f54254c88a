# SPDX-License-Identifier: Apache-2.0
"""Loading pretrained models: safetensors only, no remote code, and an error that says what to do."""

import hashlib
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

EMBEDDED = "embedded"
"""Name of the small backbones that are part of this package."""


def find_backbone(
    name: str, part: Literal["detector", "language_model"], revision: str | None
) -> tuple[str, str | None]:
    """Where a backbone is: as named, or for `embedded` its folder in this package.

    Args:
        name: Hub id, folder, or `embedded`.
        part: Which of the embedded backbones.
        revision: Hub revision; for an embedded one the digest that a checkpoint noted, or None.

    Returns:
        Name or folder, and its revision: of an embedded backbone the digest of its weights.

    Raises:
        ValueError: If a checkpoint was made with other embedded weights.
    """
    if name != EMBEDDED:
        return name, revision
    folder = Path(str(files(__package__))) / "weights" / part
    digest = hashlib.sha256((folder / "model.safetensors").read_bytes()).hexdigest()[:12]
    if revision not in (None, digest):
        raise ValueError(
            f"This checkpoint was trained with another embedded {part.replace('_', ' ')} ({revision}) than "
            f"that of the installed lerobot_policy_owlxt5 ({digest}). Install the version that it was "
            "trained with, or train again."
        )
    return str(folder), digest


def load_pretrained(
    loader: Any, name: str, revision: str | None, flag: str, alternatives: str, **options: Any
) -> Any:
    """Load a model, tokenizer or processor of transformers from the Hub or from a folder.

    Args:
        loader: A class with `from_pretrained`.
        name: Hub id or folder.
        revision: Hub revision, or None.
        flag: The command-line flag that `name` came from.
        alternatives: What else the flag takes, for the error message.
        **options: Passed on to `from_pretrained`.

    Raises:
        OSError: If it cannot be loaded, naming the flag and the alternatives.
    """
    try:
        return loader.from_pretrained(name, revision=revision, trust_remote_code=False, **options)
    except (OSError, ValueError) as error:
        reason = str(error).strip().splitlines()[0]
        raise OSError(
            f"{flag}={name} (revision {revision or 'main'}) cannot be loaded: {reason} "
            f"Check the name, the revision and the network, or give {alternatives}."
        ) from error
