# SPDX-License-Identifier: Apache-2.0
"""The policy OWLxT5: "Open-Vocabulary Robotic Object Manipulation using Foundation Models"."""

from typing import TYPE_CHECKING, Any

from .configuration_owlxt5 import OWLxT5Config
from .modeling_crossmodal import CrossmodalPolicy
from .object_point import ObjectPoint

if TYPE_CHECKING:
    from lerobot.datasets import LeRobotDatasetMetadata


class OWLxT5Policy(CrossmodalPolicy):
    """Sees where an object is, with a detector that need not have been trained on it."""

    config_class = OWLxT5Config
    name = "owlxt5"
    config: OWLxT5Config
    visual: ObjectPoint

    def __init__(
        self,
        config: OWLxT5Config,
        dataset_meta: "LeRobotDatasetMetadata | None" = None,
        **kwargs: Any,
    ) -> None:
        """Make the policy: see `CrossmodalPolicy`."""
        super().__init__(config, dataset_meta, **kwargs)
        self.visual = ObjectPoint(config)
