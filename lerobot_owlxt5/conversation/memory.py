# SPDX-License-Identifier: Apache-2.0
"""What a robot remembers of what it did, and the answers from that."""

from dataclasses import dataclass

from ..commands.replies import ABILITIES, REPLIES
from .questions import Question

_HOLDING = "I hold still"
_WORKED = {True: "Yes.", False: "No.", None: "I cannot tell."}


@dataclass
class Memory:
    """What happened last.

    Attributes:
        doing: What is going on, in the words in which it was announced; empty if nothing is.
        did: The report of the last movement, or how it ended; empty before the first.
        worked: Whether that movement was seen to succeed; None if that was not seen.
        still: Why the robot held still the last time that it was to move; empty if it moved since.
    """

    doing: str = ""
    did: str = ""
    worked: bool | None = None
    still: str = ""

    def answer(self, question: Question) -> str:
        """Answer a question about what was done."""
        match question.kind:
            case "ability":
                return ABILITIES
            case "doing":
                return f"I am at it: {self.doing}" if self.doing else "I do nothing now."
            case "did":
                return self._did
            case "worked":
                return self._worked
            case "why":
                return self._why
        return REPLIES["robot"]

    @property
    def _did(self) -> str:
        if self.doing:
            return f"I am not done yet: {self.doing}"
        return self.did or "I have not moved anything yet."

    @property
    def _worked(self) -> str:
        if self.doing:
            return "I do not know yet: I am not done."
        if not self.did:
            return "I have not moved anything yet."
        return f"{_WORKED[self.worked]} {self.did}"

    @property
    def _why(self) -> str:
        if self.still:
            rest = self.still.removeprefix(_HOLDING)
            return f"I held still{rest}" if rest != self.still else f"I held still. {self.still}"
        if self.doing:
            return f"I am moving: {self.doing}"
        return f"I did move. {self.did}" if self.did else "Nobody has asked me to move anything yet."
