# SPDX-License-Identifier: Apache-2.0
"""MuJoCo's viewer beside a running simulation: a window to look around in, which moves nothing."""

import sys
import warnings

import mujoco.viewer

from .drawing import DrawingError
from .simulation import TabletopSimulation


def _has_screen() -> bool:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # GLFW warns of what then fails
        return bool(mujoco.viewer.glfw.init())


class Viewer:
    """A window that shows a simulation, until it is closed by whoever looks, or by `close`."""

    def __init__(self, simulation: TabletopSimulation) -> None:
        """Open the window.

        Raises:
            DrawingError: If there is no screen, or macOS needs MuJoCo's own Python for it.
        """
        # Without a screen MuJoCo would wait for its window forever.
        if sys.platform != "darwin" and not _has_screen():
            raise DrawingError("the viewer needs a screen, and there is none; leave --robot.viewer=true out")
        try:
            self._handle = mujoco.viewer.launch_passive(
                simulation.model, simulation.data, show_left_ui=False, show_right_ui=False
            )
        except RuntimeError:
            raise DrawingError(
                "on macOS MuJoCo opens its viewer only from its own Python: start the command with mjpython"
            ) from None

    def show(self) -> None:
        """Draw the simulation as it is now; nothing once the window is closed."""
        if self._handle.is_running():
            self._handle.sync()

    def close(self) -> None:
        """Close the window."""
        self._handle.close()
