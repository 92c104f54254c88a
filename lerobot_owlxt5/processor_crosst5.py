# SPDX-License-Identifier: Apache-2.0
"""Pre- and post-processing of the policy CrossT5: the same as OWLxT5's."""

from .processor_owlxt5 import make_owlxt5_pre_post_processors as make_crosst5_pre_post_processors

__all__ = ["make_crosst5_pre_post_processors"]
