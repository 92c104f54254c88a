# SPDX-License-Identifier: Apache-2.0
"""What stands on the page, in both of its languages."""

from dataclasses import dataclass

ENGLISH, GERMAN = "en", "de"


@dataclass(frozen=True)
class Texts:
    """The page's words in one language; see `TEXTS`."""

    intro: str
    sends_words: str
    chat: str
    words: str
    placeholder: str
    say: str
    stop: str
    home: str
    show: str
    new_scene: str
    objects: str
    placement: str
    object_sets: dict[str, str]
    placements: dict[str, str]
    preparing: str
    waiting: str
    failed: str
    listening: str
    moving: str
    looking: str
    left: str


TEXTS = {
    ENGLISH: Texts(
        intro="NICO is simulated. It pushes, pulls and slides what stands on the table, if it sees it and "
        "understands you. Click a thing to name it, or to teach it: this is a trophy.",
        sends_words="What you say also goes to a language model on another server.",
        chat="Conversation",
        words="Your words",
        placeholder="Push the mug, please.",
        say="Say it",
        stop="Stop",
        home="Arms back",
        show="Show it",
        new_scene="New scene",
        objects="Things on the table",
        placement="Where they stand",
        object_sets={"claeo": "everyday things", "clant": "coloured cubes", "household": "household"},
        placements={"slots": "three fixed places", "free": "anywhere in reach"},
        preparing="The table is being laid.",
        waiting="All places are taken. Please wait: yours comes as soon as somebody leaves.",
        failed="Something went wrong here. Choose a new scene to go on.",
        listening="NICO is listening.",
        moving="NICO is moving.",
        looking="NICO is moving, and has its eye on: {}.",
        left="You were away. Reload the page to come back.",
    ),
    GERMAN: Texts(
        intro="NICO ist simuliert. Er schiebt, zieht und verschiebt, was auf dem Tisch steht, wenn er es "
        "sieht und Sie versteht. Klicken Sie ein Ding an, um es zu nennen oder um zu sagen, was es ist: Das "
        "ist ein Pokal.",
        sends_words="Was Sie sagen, geht auch an ein Sprachmodell auf einem anderen Server.",
        chat="Gespräch",
        words="Ihre Worte",
        placeholder="Schieb bitte den Becher.",
        say="Sagen",
        stop="Halt",
        home="Ruhelage",
        show="Vormachen",
        new_scene="Neue Szene",
        objects="Dinge auf dem Tisch",
        placement="Wo sie stehen",
        object_sets={"claeo": "Alltagsdinge", "clant": "bunte Würfel", "household": "Haushalt"},
        placements={"slots": "drei feste Plätze", "free": "überall in Reichweite"},
        preparing="Der Tisch wird gedeckt.",
        waiting="Alle Plätze sind besetzt. Bitte warten Sie: Ihrer kommt, sobald jemand geht.",
        failed="Hier ist etwas schiefgegangen. Wählen Sie eine neue Szene, um weiterzumachen.",
        listening="NICO hört zu.",
        moving="NICO bewegt sich.",
        looking="NICO bewegt sich und hat im Auge: {}.",
        left="Sie waren fort. Laden Sie die Seite neu, um wiederzukommen.",
    ),
}


def language_of(header: str) -> str:
    """The page's language for a browser.

    Args:
        header: What it sends as `Accept-Language`, such as "de-DE,de;q=0.9,en;q=0.8".

    Returns:
        The first of its languages that the page has, English if it has none.
    """
    for wish in header.split(","):
        language = wish.strip()[:2].lower()
        if language in TEXTS:
            return language
    return ENGLISH
