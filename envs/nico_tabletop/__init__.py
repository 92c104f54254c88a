# SPDX-License-Identifier: Apache-2.0
"""NICO at a table with three objects: MuJoCo world, scoring, Gymnasium and LeRobot environments."""
