# SPDX-License-Identifier: Apache-2.0
"""CLANT and CLAEO as LeRobotDatasets: the original release or a scripted expert, replayed before a camera."""

import lerobot_policy_owlxt5  # noqa: F401  the names of objects must be such that policies understand commands
