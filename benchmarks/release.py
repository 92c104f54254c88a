# SPDX-License-Identifier: Apache-2.0
"""Where the benchmarks find the original release."""

import os

_VARIABLE = "OWLXT5_CLANT_DIR"


def release_folder() -> str:
    """The folder of the release, as the environment names it.

    Raises:
        ValueError: If it names none.
    """
    if not (folder := os.environ.get(_VARIABLE)):
        raise ValueError(f"this needs the original release: set {_VARIABLE} to its folder CLANT")
    return folder
