# SPDX-License-Identifier: Apache-2.0
"""One of several, by chance."""

from collections.abc import Sequence

import numpy as np


def pick[Item](random: np.random.Generator, items: Sequence[Item]) -> Item:
    """Any of the items, each as likely."""
    return items[int(random.integers(len(items)))]
