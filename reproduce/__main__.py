# SPDX-License-Identifier: Apache-2.0
"""`python -m reproduce --size=quick`, which is `make reproduce`."""

import os
import sys
from dataclasses import dataclass

from rich.console import Console

from lerobot_owlxt5.command_line import command

from .plan import RELEASE, Setting, read_plan
from .report import write_report
from .run import RunError, heed_signals, run


@dataclass
class ReproduceConfig:
    """Build, train and evaluate all that a size of reproduce/plan.yaml has, and write docs/results.md."""

    # `quick`, `full` or `hub`.
    size: str = "quick"


@command("reproduce", RunError)
def main(config: ReproduceConfig) -> None:
    """Run what is not whole yet, and write the results."""
    import torch  # takes seconds

    # The variable, not its value: nobody's folders stand in commands that others read.
    source = f'"${RELEASE}"' if os.environ.get(RELEASE) else "scripted"
    setting = Setting(source, "cuda" if torch.cuda.is_available() else "cpu")
    plan = read_plan(config.size, setting=setting)
    heed_signals()
    console = Console()
    try:
        run(plan, console)
    except KeyboardInterrupt:
        sys.exit(f"\nreproduce: interrupted; make reproduce SIZE={config.size} goes on where it stopped")
    finally:
        write_report(config.size, console)


if __name__ == "__main__":
    main()
