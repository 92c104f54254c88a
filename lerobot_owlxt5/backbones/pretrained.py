# SPDX-License-Identifier: Apache-2.0
"""Loading pretrained models: safetensors only, no remote code, and an error that says what to do."""

import hashlib
import re
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

from httpx import HTTPError
from huggingface_hub import get_hf_file_metadata, hf_hub_url, try_to_load_from_cache

EMBEDDED = "embedded"
"""Name of the small backbones that are part of this package."""
_CONFIG = "config.json"  # each model has one
_DIGEST = 12
"""Digits of the digest of embedded weights."""


def find_backbone(
    name: str, part: Literal["detector", "language_model", "understanding"], revision: str | None
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
    revision = _own_revision(name, revision)
    if name != EMBEDDED:
        return name, revision
    folder = Path(str(files(__package__))) / "weights" / part
    digest = hashlib.sha256((folder / "model.safetensors").read_bytes()).hexdigest()[:_DIGEST]
    if revision not in (None, digest):
        raise ValueError(
            f"This checkpoint was trained with another embedded {part.replace('_', ' ')} ({revision}) than "
            f"that of the installed lerobot_policy_owlxt5 ({digest}). Install the version that it was "
            "trained with, or train again."
        )
    return str(folder), digest


def check_backbones(backbones: Mapping[str, tuple[str, str | None]]) -> None:
    """Check that all backbones can be had, before any of them is loaded: without a network, none can.

    Args:
        backbones: Name (Hub id, folder, or `embedded`) and Hub revision or None, by option, such as
            `{"language_model": ("google-t5/t5-small", None)}`.

    Raises:
        OSError: One for all that cannot be had, naming their flags.
    """
    missing = {}
    for option, (name, noted) in backbones.items():
        revision = _own_revision(name, noted)
        if name == EMBEDDED or Path(name).is_dir():
            continue
        try:
            if not isinstance(try_to_load_from_cache(name, _CONFIG, revision=revision), str):
                get_hf_file_metadata(hf_hub_url(name, _CONFIG, revision=revision))
        except (OSError, ValueError, HTTPError) as error:
            reason = (str(error).strip() or type(error).__name__).partition("\n")[0].rstrip(".")
            missing[option] = f"--policy.{option}={name} (revision {revision or 'main'}) because: {reason}."
    if missing:
        instead = " ".join(f"--policy.{option}={EMBEDDED}" for option in missing)
        raise OSError(
            f"The policy's pretrained models cannot be had: {' '.join(missing.values())} Check names, "
            f"revisions and network, or give {instead}: what is embedded needs no network."
        )


def _own_revision(name: str, revision: str | None) -> str | None:
    """A revision, if it can be one of this backbone: another one's was noted before the name was changed."""
    is_digest = re.fullmatch(f"[0-9a-f]{{{_DIGEST}}}", revision or "") is not None
    return revision if is_digest == (name == EMBEDDED) else None


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
        ) from None
