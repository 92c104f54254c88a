# SPDX-License-Identifier: Apache-2.0
"""Pre- and post-processing of the policy early_fusion: the same as OWLxT5's, so joints share their bins."""

from .processor_owlxt5 import make_owlxt5_pre_post_processors as make_early_fusion_pre_post_processors

__all__ = ["make_early_fusion_pre_post_processors"]
