# SPDX-License-Identifier: Apache-2.0
"""The NICO humanoid at a table with three objects: MuJoCo world, scoring, Gymnasium and LeRobot environments."""
