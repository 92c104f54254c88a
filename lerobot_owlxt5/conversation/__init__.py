# SPDX-License-Identifier: Apache-2.0
"""A conversation with a robot: it hears, understands, looks, acts, looks again, and answers."""

from .conversation import Conversation
from .lines import Line

__all__ = ["Conversation", "Line"]
