# SPDX-License-Identifier: Apache-2.0
"""A choice that leaves the items as they are: `Generator.choice` makes NumPy's types of them."""

from collections.abc import Sequence

import numpy as np


def choice[Item](rng: np.random.Generator, items: Sequence[Item]) -> Item:
    """Any of the items, each as likely."""
    return items[int(rng.integers(len(items)))]
