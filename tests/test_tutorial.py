# SPDX-License-Identifier: Apache-2.0
"""The README's Python example runs as it stands, with a small random policy in place of the demo's."""

import re
from pathlib import Path
from typing import Any

import pytest
from lerobot.datasets import LeRobotDataset
from lerobot.policies.factory import make_pre_post_processors

from policy_helpers import make_owlv2, make_policy

README = Path(__file__).parent.parent / "README.md"
CHECKPOINT = "outputs/demo/train/checkpoints/last/pretrained_model"


def test_the_readmes_example_runs(
    dataset: LeRobotDataset, t5: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    policy = make_policy(t5, detector=str(make_owlv2(tmp_path / "owlv2")), score_threshold=0.0)
    policy.save_pretrained(tmp_path)
    for processor in make_pre_post_processors(policy.config, dataset_stats=dataset.meta.stats):
        processor.save_pretrained(tmp_path)
    [code] = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert CHECKPOINT in code
    capsys.readouterr()
    names: dict[str, Any] = {}
    exec(code.replace(CHECKPOINT, str(tmp_path)), names)
    answer, description, outcome = capsys.readouterr().out.splitlines()[-3:]
    assert answer == f"I will push the {names['name']}."
    assert description
    assert outcome in ("perfect", "successful", "failure")
