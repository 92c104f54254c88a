# SPDX-License-Identifier: Apache-2.0
"""Loading pretrained models: safetensors only, no remote code, and an error that says what to do."""

from typing import Any


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
