# SPDX-License-Identifier: Apache-2.0
"""Uploads a dataset to the Hugging Face Hub.

`LeRobotDataset.push_to_hub` would replace our card with a generic one and tag that; so its steps stand here,
with all files in one commit: the Hub holds the whole dataset or none of it, and files of an earlier one go.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import httpx
from huggingface_hub import HfApi, get_token, logging
from huggingface_hub.errors import RevisionNotFoundError
from lerobot.datasets import CODEBASE_VERSION

_DATASET = "dataset"


class HubError(Exception):
    """The Hub could not be reached or refused; the message says what to do."""


def create_repository(repo_id: str, *, private: bool) -> None:
    """Make the repository `repo_id`, or check that an existing one will do.

    Called before a dataset is built: what is wrong with a token or a name shows at once.

    Raises:
        HubError: If there is no valid token, if it may not write there, if the Hub cannot be reached, or if
            the repository must be private and is public.
    """
    if get_token() is None:
        raise HubError("there is no token for the Hub: run `hf auth login`, or set HF_TOKEN")
    with _explained(repo_id):
        api = HfApi()
        api.create_repo(repo_id, repo_type=_DATASET, private=private, exist_ok=True)
        public = not api.repo_info(repo_id, repo_type=_DATASET).private
    if private and public:
        raise HubError(
            f"{repo_id} exists and is public, but this dataset is to be private: choose another --repo_id, "
            "make the repository private in its settings on the Hub, or say --private=false"
        )


def upload(root: Path, repo_id: str) -> str:
    """Upload the dataset in `root` to an existing repository and tag it with the version of its format.

    What an interrupted upload has stored is not sent again.

    Returns:
        The address of its page.

    Raises:
        HubError: If the upload does not come to its end.
    """
    # What is logged at a retry names addresses that are signed for this upload: not for a log.
    logging.set_verbosity_error()
    with _explained(repo_id):
        api = HfApi()
        api.upload_folder(
            repo_id=repo_id,
            repo_type=_DATASET,
            folder_path=root,
            delete_patterns=["data/**", "meta/**", "videos/**"],
            commit_message="Upload with owlxt5-dataset",
        )
        with suppress(RevisionNotFoundError):
            api.delete_tag(repo_id, tag=CODEBASE_VERSION, repo_type=_DATASET)
        api.create_tag(repo_id, tag=CODEBASE_VERSION, repo_type=_DATASET)
    return f"{api.endpoint}/datasets/{repo_id}"


@contextmanager
def _explained(repo_id: str) -> Iterator[None]:
    """Turn what the Hub's client raises into one message."""
    try:
        yield
    # A failed upload of a file is a RuntimeError that is raised from what happened.
    except (httpx.HTTPError, OSError, RuntimeError) as error:
        cause = error.__cause__ if isinstance(error, RuntimeError) and error.__cause__ else error
        response = getattr(cause, "response", None)
        status = None if response is None else response.status_code
        if status == 401:
            message = "the Hub does not know the token: run `hf auth login`, or set HF_TOKEN"
        elif status == 403:
            message = f"the token may not write to {repo_id}: use one that may, or --repo_id=<your name>/…"
        else:
            reason = f"the Hub answered {status}" if status else " ".join(str(cause).split())
            message = f"{repo_id} was not uploaded ({reason}); the same command sends what is missing"
        raise HubError(message) from error
