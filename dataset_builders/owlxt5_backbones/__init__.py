# SPDX-License-Identifier: Apache-2.0
"""Makes and trains the small backbones that the package ships: a detector and a language model."""
