# SPDX-License-Identifier: Apache-2.0
"""Drawing with MuJoCo: without a screen, unless `MUJOCO_GL` says otherwise; where it fails, one sentence."""

import os
import sys
import threading
import warnings

_VARIABLE = "MUJOCO_GL"

# MuJoCo looks only once, when it is imported. A screen need not be alive because `DISPLAY` names one.
if sys.platform == "linux" and "mujoco" not in sys.modules and not os.environ.get(_VARIABLE):
    os.environ[_VARIABLE] = "egl"

_missing: Exception | None = None
try:
    import mujoco
except (AttributeError, ImportError, OSError, RuntimeError) as error:  # each drawing library has its own
    # Training and planning need no image, so MuJoCo is imported without, and says so when one is asked for.
    _missing, _asked = error, os.environ.get(_VARIABLE)
    os.environ[_VARIABLE] = "off"
    import mujoco

    if _asked is None:
        del os.environ[_VARIABLE]
    else:
        os.environ[_VARIABLE] = _asked

ONE_DRAWS = threading.RLock()
"""Held by the thread that draws, or makes or frees what draws.

Mesa's software renderer broke down after 22 minutes in which two threads did so at the same time (measured).
"""
SMALLEST_IMAGE, LARGEST_IMAGE = 16, 1920
"""Rows and columns of an image: less shows nothing, and MuJoCo's buffer (`assets/scene.xml`) has no more."""


class DrawingError(RuntimeError):
    """MuJoCo cannot draw on this machine; the message names `MUJOCO_GL`."""


def check_image_size(height: int, width: int) -> None:
    """Check that MuJoCo can draw an image.

    Raises:
        ValueError: Naming the side that is too small or too large.
    """
    for name, side in (("height", height), ("width", width)):
        if not SMALLEST_IMAGE <= side <= LARGEST_IMAGE:
            raise ValueError(
                f"the {name} of an image must lie between {SMALLEST_IMAGE} and {LARGEST_IMAGE}; got {side}"
            )


def make_renderer(model: mujoco.MjModel, height: int, width: int) -> mujoco.Renderer:
    """A renderer with a GL context of its own, for the process that makes it.

    Raises:
        DrawingError: If there is no GL context to be had.
    """
    try:
        with ONE_DRAWS, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # GLFW warns of what then fails
            return mujoco.Renderer(model, height, width)
    except Exception as error:  # each drawing library raises its own
        reason = " ".join(str(_missing or error).split()).rstrip(".")
        raise DrawingError(
            f"MuJoCo cannot draw with {_VARIABLE}={os.environ.get(_VARIABLE, '')} ({reason}). Before Python "
            f"starts, set {_VARIABLE} to egl, osmesa or glfw; for egl, Debian and Ubuntu need the packages "
            "libegl1 and libgl1-mesa-dri."
        ) from None
