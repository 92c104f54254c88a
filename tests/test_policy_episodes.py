# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from lerobot.datasets import LeRobotDatasetMetadata
from lerobot.datasets.dataset_tools import modify_tasks

from lerobot_owlxt5.configuration_owlxt5 import OWLxT5Config
from lerobot_owlxt5.data.episode_store import EpisodeStore, find_long_episode
from lerobot_owlxt5.data.windows import at_step, finished_episode, positions_before, recover_actions
from policy_helpers import make_dataset


@st.composite
def windows(draw: st.DrawFn) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """An episode of 1 to L actions, and the window that LeRobot cuts around one of its frames."""
    horizon = draw(st.integers(1, 20))
    length = draw(st.integers(1, horizon))
    frame = draw(st.integers(0, length - 1))
    episode = torch.arange(length)[:, None] + torch.tensor([0.0, 100.0])
    wanted = frame + torch.tensor(OWLxT5Config(max_episode_steps=horizon, device="cpu").episode_delta_indices)
    return episode, episode[wanted.clamp(0, length - 1)], (wanted < 0) | (wanted >= length)


@given(windows())
def test_the_episode_is_recovered_from_any_of_its_frames(window: tuple[torch.Tensor, ...]) -> None:
    episode, actions, is_pad = window
    recovered, length = recover_actions(actions[None], is_pad[None])
    assert int(length) == len(episode)
    assert recovered.shape[1] == (len(actions) + 1) // 2
    assert torch.equal(recovered[0, : len(episode)], episode)
    assert (recovered[0, len(episode) :] == episode[-1]).all()


def test_positions_are_the_first_pose_and_then_each_target() -> None:
    actions = torch.arange(6.0).view(1, 3, 2)
    assert positions_before(torch.full((1, 2), 9.0), actions).tolist() == [[[9, 9], [0, 1], [2, 3]]]


def test_a_step_is_taken_with_and_without_a_time_axis() -> None:
    states = torch.arange(12.0).view(2, 3, 2)
    assert torch.equal(at_step(states, -1), states[:, 2])
    assert torch.equal(at_step(states[:, 0], -1), states[:, 0])


def test_texts_are_read_from_the_dataset(tmp_path: Path) -> None:
    meta = make_dataset(tmp_path / "data", episodes=2).meta
    store = EpisodeStore(meta)
    texts = store.texts
    assert set(texts) == {0, 1}
    assert texts[1].wordings[1].startswith("move-down ")
    assert len(texts[1].wordings) == 4
    assert texts[1].sentence == "The Commission met 1 times."
    assert texts[1].translation == "Die Kommission trat 1 Mal zusammen."


def test_the_longest_of_the_chosen_episodes_counts(tmp_path: Path) -> None:
    meta = make_dataset(tmp_path / "data", episodes=2).meta
    assert find_long_episode(meta, 9) == find_long_episode(meta, 8, [0]) == ""
    sentence = find_long_episode(meta, 8)
    assert sentence.startswith("Episode 1 of test/synthetic has 9 steps")
    assert sentence.endswith(
        "Set --policy.max_episode_steps=9, or leave the episode out with --dataset.episodes."
    )


def test_wordings_of_another_task_are_left_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """As after `lerobot-edit-dataset --operation.type=modify_tasks`."""
    dataset = make_dataset(tmp_path / "data", episodes=3)
    before = EpisodeStore(dataset.meta).texts
    caplog.clear()
    modify_tasks(dataset, episode_tasks={0: "push the crimson block", 1: before[1].wordings[3]})
    after = EpisodeStore(LeRobotDatasetMetadata("test/synthetic", root=tmp_path / "data")).texts
    assert after[0].wordings == ()
    assert (after[0].sentence, after[0].translation) == (before[0].sentence, before[0].translation)
    assert (after[1], after[2]) == (before[1], before[2])  # one of its wordings means the same
    assert "wordings of 1 episodes of test/synthetic, such as 0, are of another task" in caplog.text


def test_a_dataset_without_texts_has_none(tmp_path: Path) -> None:
    assert EpisodeStore(make_dataset(tmp_path / "data", episodes=1, texts=False).meta).texts == {}


@given(windows())
def test_a_rollout_becomes_what_the_loader_gives(window: tuple[torch.Tensor, ...]) -> None:
    episode, _, _ = window
    observation = {"observation.state": torch.zeros(2, 3), "task": ["push red"] * 2}
    # After the last action the pose is held, as a policy does it until the environment ends.
    actions = [action.expand(2, -1) for action in [*episode, *episode[-1:]]]
    batch = finished_episode([observation] * 2, actions, max_episode_steps=20)
    assert batch["action"].shape == (2, 39, 2)
    recovered, length = recover_actions(batch["action"], batch["action_is_pad"])
    assert length.tolist() == [len(episode)] * 2
    assert torch.equal(recovered[1, : len(episode)], episode)
    assert batch["task"] == ["push red"] * 2


def test_a_rollout_that_is_too_long_is_no_episode() -> None:
    observation = {"observation.state": torch.zeros(1, 3), "task": ["push red"]}
    with pytest.raises(ValueError, match=r"1 to 5 actions .* not 6"):
        finished_episode([observation] * 2, [torch.full((1, 3), i) for i in range(6)], 5)
