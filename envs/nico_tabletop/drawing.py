# SPDX-License-Identifier: Apache-2.0
"""Drawing with MuJoCo: without a screen, unless `MUJOCO_GL` says otherwise; where it fails, one sentence."""

import os
import sys
import threading
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from queue import SimpleQueue

import numpy as np
from numpy.typing import NDArray

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


class Renderer:
    """Draws what the cameras of a model see, in images of any size; whoever calls, one thread draws.

    Mesa's software renderer broke down after 22 minutes in which two threads drew at the same time, and it
    compiles its shaders anew for each GL context, 0.2 to 0.3 s (both measured): a process has one of each.

    Attributes:
        model: What is drawn; its textures and meshes are those that it had at first.
        scene: Its shapes, as the last `update` found them.

    Raises:
        DrawingError: If there is no GL context to be had.
    """

    _context: mujoco.MjrContext | None = None

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self.scene = mujoco.MjvScene(model, maxgeom=_MOST_GEOMS)
        self._options = mujoco.MjvOption()
        try:
            self._context = _by_one_thread(_make_context, model)
        except Exception as error:  # each drawing library raises its own
            reason = " ".join(str(_missing or error).split()).rstrip(".")
            raise DrawingError(
                f"MuJoCo cannot draw with {_VARIABLE}={os.environ.get(_VARIABLE, '')} ({reason}). "
                f"Before Python starts, set {_VARIABLE} to egl, osmesa or glfw; for egl, Debian and Ubuntu "
                "need the packages libegl1 and libgl1-mesa-dri."
            ) from None

    def update(self, data: mujoco.MjData, camera: str) -> None:
        """Fill the scene with what a camera sees, after `mj_forward`."""
        view = mujoco.MjvCamera()
        view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, self.model.camera(camera).id
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self.model, data, self._options, None, view, everything, self.scene)

    def draw(self, height: int, width: int) -> NDArray[np.uint8]:
        """The scene's image, shape (height, width, 3), RGB."""
        return _by_one_thread(_draw, self.scene, self._context, height, width)

    def close(self) -> None:
        """Free what draws it, as soon as the next image is drawn, by whomever."""
        if self._context is not None:
            _unused.put(self._context)
            self._context = None

    __del__ = close  # else any thread might free it, and with it what belongs to another GL context


_MOST_GEOMS = 10_000  # of a scene, as in `mujoco.Renderer`
_unused: SimpleQueue[mujoco.MjrContext] = SimpleQueue()
_of_thread = threading.local()


def _by_one_thread[**P, T](function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    return _drawing_thread(os.getpid()).submit(function, *args, **kwargs).result()


@cache
def _drawing_thread(process: int) -> ThreadPoolExecutor:
    """Of a process, as a fork takes no thread along."""
    return ThreadPoolExecutor(max_workers=1, thread_name_prefix=f"drawing of {process}")


def _make_context(model: mujoco.MjModel) -> mujoco.MjrContext:
    if not hasattr(_of_thread, "gl"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # GLFW warns of what then fails
            context = mujoco.GLContext(LARGEST_IMAGE, LARGEST_IMAGE)
        context.make_current()
        _of_thread.gl = context
    return mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)


def _draw(scene: mujoco.MjvScene, context: mujoco.MjrContext, height: int, width: int) -> NDArray[np.uint8]:
    while not _unused.empty():
        _unused.get().free()
    area, image = mujoco.MjrRect(0, 0, width, height), np.empty((height, width, 3), dtype=np.uint8)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
    mujoco.mjr_render(area, scene, context)
    mujoco.mjr_readPixels(image, None, area, context)
    return image[::-1].copy()  # OpenGL's first row is the lowest
