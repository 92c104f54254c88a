# SPDX-License-Identifier: Apache-2.0
"""Puts a trained policy into the package: `python -m owlxt5_policy.ship`."""
