# SPDX-License-Identifier: Apache-2.0
"""The commands that mean one action on one object."""

from nico_tabletop.objects import TabletopObject
from nico_tabletop.tasks import Action


def wordings(action: Action, target: TabletopObject) -> tuple[str, ...]:
    """The four accepted commands in the release's order: canonical words first, the verb changes fastest.

    As in the release, there are two verbs and two nouns: the object's name and its first synonym.
    """
    verbs = action.verb.name, action.verb.synonym
    return tuple(f"{verb} {noun}" for noun in (target.name, target.synonyms[0]) for verb in verbs)
