# SPDX-License-Identifier: Apache-2.0
"""The pretrained models: language model, detectors, how they are loaded, and the small ones that ship."""
