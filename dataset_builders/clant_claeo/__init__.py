# SPDX-License-Identifier: Apache-2.0
"""CLANT and CLAEO as LeRobotDatasets: the original release or a scripted expert, replayed before a camera."""
