# SPDX-License-Identifier: Apache-2.0
"""Reading a LeRobotDataset: whole episodes, texts, frames, normalization."""
