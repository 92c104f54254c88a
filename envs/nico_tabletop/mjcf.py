# SPDX-License-Identifier: Apache-2.0
"""MJCF as text: the face of MuJoCo that stays the same from 3.8 to 4.x."""


def text(*numbers: float) -> str:
    """Numbers as an MJCF attribute."""
    return " ".join(f"{number:.9g}" for number in numbers)
