# SPDX-License-Identifier: Apache-2.0
"""Commands: verbs, understanding what was said, the prompts of the modes."""
