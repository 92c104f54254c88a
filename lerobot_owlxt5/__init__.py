# SPDX-License-Identifier: Apache-2.0
"""The policy OWLxT5 for LeRobot. Importing this package registers `--policy.type=owlxt5`."""

from .configuration_owlxt5 import OWLxT5Config

__all__ = ["OWLxT5Config"]
