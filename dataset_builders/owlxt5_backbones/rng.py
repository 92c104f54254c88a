# SPDX-License-Identifier: Apache-2.0
"""A choice that leaves the items as they are: `Generator.choice` makes NumPy's types of them."""

from collections.abc import Sequence

import numpy as np


def choice[Item](
    rng: np.random.Generator, items: Sequence[Item], shares: Sequence[float] | None = None
) -> Item:
    """Any of the items, each as likely, or as likely as its share says; the shares sum up to 1."""
    if shares is None:
        return items[int(rng.integers(len(items)))]
    return items[int(rng.choice(len(items), p=shares))]
