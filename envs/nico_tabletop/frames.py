# SPDX-License-Identifier: Apache-2.0
"""The sentences of the protocol CLAEO-Plus, by kind and verb; `{}` is the object, such as "red cube".

All are our own. "You" is the robot, so that each direction is meant as the robot sees it. No sentence names
a side but its verb's, and each asks for one movement of one object.
"""

_SIDES = ("left", "right")


def _by_verb(push: str, pull: str, slide: str) -> dict[str, tuple[str, ...]]:
    """The sentences of each verb, one a line; `[side]` stands for the side to which something slides."""
    frames = {"push": push, "pull": pull}
    frames |= {f"slide-to-{side}": slide.replace("[side]", side) for side in _SIDES}
    return {verb: tuple(filter(None, map(str.strip, text.splitlines()))) for verb, text in frames.items()}


PLAIN: dict[str, str] = {
    "push": "push the {} away",
    "pull": "pull the {} closer",
    **{f"slide-to-{side}": f"slide the {{}} to the {side}" for side in _SIDES},
}
"""A plain command for each verb, in which typing errors are made."""

PUNCTUATION: tuple[str, ...] = (
    "{upper}",
    "{upper}!!!",
    "{capital}!",
    "{capital}...",
    "hey,{plain},please",
    "NICO,{plain}!",
    "please,,{plain} .",
    "“{capital}.”",
    "- {plain};",
    "{title}",
    "  {plain}  ",
    "({plain})",
)
"""Ways to write a plain command: as it is, in capitals, with one capital, or with one a word."""

SYNONYMS = _by_verb(
    push="""
        shove the {} away
        thrust the {} forward
        move the {} forward
        budge the {} away from you
        press the {} forward
        propel the {} away from you
        prod the {} away
    """,
    pull="""
        drag the {} closer
        tug the {} towards you
        draw the {} near
        haul the {} back
        bring the {} closer
        fetch the {} nearer
        tow the {} towards you
    """,
    slide="""
        shift the {} to the [side]
        glide the {} to the [side]
        move the {} to the [side]
        sweep the {} to your [side]
        nudge the {} [side]wards
        scoot the {} over to the [side]
        displace the {} to the [side]
    """,
)
"""Commands with other verbs than CLANT's."""

PARAPHRASES: dict[str, dict[str, tuple[str, ...]]] = {
    "polite": _by_verb(
        push="""
            Would you please be good enough to push the {} away from you?
            Please do me the favour of pushing the {} forward.
            Might I ask you to push the {} a bit away from you, please?
            Kindly push the {} away, thank you.
            I would be grateful if you pushed the {} away from you.
            If it is not too much to ask, please push the {} forward.
        """,
        pull="""
            Would you please be good enough to pull the {} towards you?
            Please do me the favour of pulling the {} closer to you.
            Might I ask you to pull the {} a bit nearer to you, please?
            Kindly pull the {} towards you, thank you.
            I would be grateful if you pulled the {} closer to you.
            If it is not too much to ask, please pull the {} back towards you.
        """,
        slide="""
            Would you please be good enough to slide the {} to the [side]?
            Please do me the favour of sliding the {} to your [side].
            Might I ask you to slide the {} a bit to the [side], please?
            Kindly slide the {} to the [side], thank you.
            I would be grateful if you slid the {} to the [side].
            If it is not too much to ask, please slide the {} over to the [side].
        """,
    ),
    "need": _by_verb(
        push="""
            I need the {} farther away from you.
            What I need is the {} pushed away from you.
            I want the {} to be at a greater distance from you.
            We need more room between you and the {}, so push it away.
            It is necessary that you push the {} away.
            I require the {} to be pushed forward.
        """,
        pull="""
            I need the {} closer to you.
            What I need is the {} pulled towards you.
            I want the {} to be at a smaller distance from you.
            We need less room between you and the {}, so pull it closer.
            It is necessary that you pull the {} towards you.
            I require the {} to be pulled back.
        """,
        slide="""
            I need the {} farther to the [side].
            What I need is the {} slid to the [side].
            I want the {} to be a little more to your [side].
            We need the {} more to the [side], so slide it over.
            It is necessary that you slide the {} to the [side].
            I require the {} to be slid over to the [side].
        """,
    ),
    "ability": _by_verb(
        push="""
            Are you able to push the {} away from you?
            Do you think you can push the {} forward?
            Is it possible for you to push the {} away?
            Could you manage to push the {} away from you?
            Can your arm push the {} forward?
            Would you be capable of pushing the {} away?
        """,
        pull="""
            Are you able to pull the {} towards you?
            Do you think you can pull the {} closer?
            Is it possible for you to pull the {} back towards you?
            Could you manage to pull the {} nearer to you?
            Can your arm pull the {} closer to you?
            Would you be capable of pulling the {} towards you?
        """,
        slide="""
            Are you able to slide the {} to the [side]?
            Do you think you can slide the {} to your [side]?
            Is it possible for you to slide the {} over to the [side]?
            Could you manage to slide the {} to the [side]?
            Can your arm slide the {} to the [side]?
            Would you be capable of sliding the {} to the [side]?
        """,
    ),
    "embedded": _by_verb(
        push="""
            What I would like you to do is to push the {} away from you.
            I was hoping that you would push the {} forward.
            The next thing that has to happen is that you push the {} away.
            I think that it is time for you to push the {} away from you.
            My wish, if you ask me, is that you push the {} forward.
            They told me that you are the one who pushes the {} away, so please do.
        """,
        pull="""
            What I would like you to do is to pull the {} towards you.
            I was hoping that you would pull the {} closer.
            The next thing that has to happen is that you pull the {} towards you.
            I think that it is time for you to pull the {} nearer to you.
            My wish, if you ask me, is that you pull the {} closer to you.
            They told me that you are the one who pulls the {} closer, so please do.
        """,
        slide="""
            What I would like you to do is to slide the {} to the [side].
            I was hoping that you would slide the {} to your [side].
            The next thing that has to happen is that you slide the {} to the [side].
            I think that it is time for you to slide the {} over to the [side].
            My wish, if you ask me, is that you slide the {} to the [side].
            They told me that you are the one who slides the {} to the [side], so please do.
        """,
    ),
    "coordination": _by_verb(
        push="""
            Reach for the {} and push it away from you.
            Look for the {} and then push it forward.
            Put your hand behind the {} and push it away.
            Find the {}, touch it, and push it away from you.
            Stretch out your arm and push the {} forward.
            Go to the {} and give it a push away from you.
        """,
        pull="""
            Reach for the {} and pull it towards you.
            Look for the {} and then pull it closer.
            Put your hand around the {} and pull it back towards you.
            Find the {}, touch it, and pull it closer to you.
            Stretch out your arm and pull the {} nearer to you.
            Go to the {} and give it a pull towards you.
        """,
        slide="""
            Reach for the {} and slide it to the [side].
            Look for the {} and then slide it to your [side].
            Put your hand beside the {} and slide it over to the [side].
            Find the {}, touch it, and slide it to the [side].
            Stretch out your arm and slide the {} to the [side].
            Go to the {} and let it slide to the [side].
        """,
    ),
    "addressed": _by_verb(
        push="""
            NICO, push the {} away from you.
            Push the {} forward, NICO.
            Hello NICO, your task is to push the {} away.
            Robot, push the {} away from you now.
            Listen, NICO: push the {} forward.
            You there, my robot, push the {} away.
        """,
        pull="""
            NICO, pull the {} towards you.
            Pull the {} closer, NICO.
            Hello NICO, your task is to pull the {} closer to you.
            Robot, pull the {} towards you now.
            Listen, NICO: pull the {} back towards you.
            You there, my robot, pull the {} closer.
        """,
        slide="""
            NICO, slide the {} to the [side].
            Slide the {} to your [side], NICO.
            Hello NICO, your task is to slide the {} to the [side].
            Robot, slide the {} over to the [side] now.
            Listen, NICO: slide the {} to the [side].
            You there, my robot, slide the {} to the [side].
        """,
    ),
    "result": _by_verb(
        push="""
            The {} should end up farther away from you.
            In the end the {} must stand farther forward.
            Make sure that the {} is farther from you afterwards.
            When you are done, the {} has to be farther away from you.
            See to it that the {} gets away from you.
            The distance between you and the {} should grow.
        """,
        pull="""
            The {} should end up closer to you.
            In the end the {} must stand nearer to you.
            Make sure that the {} is closer to you afterwards.
            When you are done, the {} has to be nearer to you.
            See to it that the {} gets closer to you.
            The distance between you and the {} should shrink.
        """,
        slide="""
            The {} should end up farther to the [side].
            In the end the {} must stand more to your [side].
            Make sure that the {} is farther to the [side] afterwards.
            When you are done, the {} has to be farther to the [side].
            See to it that the {} gets over to the [side].
            A new place for the {}, farther to the [side], is what should come out.
        """,
    ),
    "colloquial": _by_verb(
        push="""
            C'mon, give that {} a shove, away from you.
            Mind shoving the {} away a bit?
            Ok so just push that {} off a little, away from you, yeah?
            Gotta have that {} pushed away, mate.
            Be a pal and push the {} forward, will ya?
            Wanna push the {} away for me?
        """,
        pull="""
            C'mon, give that {} a tug, towards you.
            Mind pulling the {} over to you a bit?
            Ok so just pull that {} in a little, towards you, yeah?
            Gotta have that {} pulled closer to you, mate.
            Be a pal and pull the {} in towards you, will ya?
            Wanna pull the {} closer for me?
        """,
        slide="""
            C'mon, scoot that {} over, to the [side].
            Mind sliding the {} over to the [side] a bit?
            Ok so just slide that {} along a little, to your [side], yeah?
            Gotta have that {} slid to the [side], mate.
            Be a pal and slide the {} to the [side], will ya?
            Wanna slide the {} to the [side] for me?
        """,
    ),
}
"""Paraphrases by kind, at least six of each kind for each verb."""
