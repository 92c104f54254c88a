# SPDX-License-Identifier: Apache-2.0
"""The policies OWLxT5 and CrossT5 for LeRobot: importing this package registers their `--policy.type`."""

from .configuration_crosst5 import CrossT5Config
from .configuration_owlxt5 import OWLxT5Config

__all__ = ["CrossT5Config", "OWLxT5Config"]
