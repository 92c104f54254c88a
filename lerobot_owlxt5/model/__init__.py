# SPDX-License-Identifier: Apache-2.0
"""The network: crossmodal Transformer, action path, autoencoder."""
