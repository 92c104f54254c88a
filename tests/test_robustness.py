# SPDX-License-Identifier: Apache-2.0
"""The benchmark of robustness: what its cells draw, what it plays, and what it makes of that."""

import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch
from rich.console import Console

from nico_tabletop.objects import read_objects
from nico_tabletop.placement import SLOT_POSES
from nico_tabletop.robot import INITIAL_POSE_DEG
from nico_tabletop.simulation import TabletopSimulation
from nico_tabletop.starts import hands_are_clear
from nico_tabletop.tasks import ACTIONS, find_action
from policy_helpers import make_policy

CUBES = read_objects("clant")
MODULES = ("cells", "rollout", "robustness", "understanding")


@pytest.fixture(scope="module")
def benchmark() -> Iterator[ModuleType]:
    """`benchmarks/robustness.py`, which finds its neighbours as a script does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(Path(__file__).parents[1] / "benchmarks")
        import robustness

        yield robustness
    for name in MODULES:
        sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def cells(benchmark: ModuleType) -> ModuleType:
    return sys.modules["cells"]


@pytest.fixture(scope="module")
def rollout(benchmark: ModuleType) -> ModuleType:
    return sys.modules["rollout"]


@pytest.fixture(scope="module")
def cubes() -> Iterator[TabletopSimulation]:
    simulation = TabletopSimulation(CUBES)
    yield simulation
    simulation.close()


def test_a_cell_draws_the_same_for_everyone_and_all_cells_have_the_same_objects(cells: ModuleType) -> None:
    for number, action in enumerate(ACTIONS):
        plain = cells.CELLS["slots"].draw(CUBES, action, scene=number)
        for name, cell in cells.CELLS.items():
            drawn = cell.draw(CUBES, action, scene=number)
            assert drawn == cell.draw(CUBES, action, scene=number), name
            assert drawn.arrangement == plain.arrangement and action in drawn.commands
            assert hands_are_clear(drawn.poses, drawn.conditions)
    assert plain != cells.CELLS["slots"].draw(CUBES, action, scene=number + 1)
    assert plain != cells.CELLS["slots"].draw(CUBES, action, scene=number, seed=1)


@pytest.mark.parametrize("distance", [1, 2, 3, 4])
def test_objects_stand_exactly_so_far_off_their_slots(cells: ModuleType, distance: int) -> None:
    shifts = [
        cells.CELLS[f"off{distance}"].draw(CUBES, action, 0).conditions.shift_cm for action in ACTIONS[:4]
    ]
    np.testing.assert_allclose(np.linalg.norm(shifts, axis=2), distance)
    assert np.ptp(np.array(shifts), axis=(0, 1)).min() > distance / 2, "in many directions"


@pytest.mark.parametrize("number", range(12))
def test_what_is_asked_for_before(cells: ModuleType, number: int) -> None:
    action = ACTIONS[number]
    opposite, second, three = (
        cells.CELLS[name].draw(CUBES, action, 0) for name in ("opposite", "second", "three")
    )
    assert opposite.first.slot == action.slot
    assert np.array_equal(opposite.first.verb.direction, -np.array(action.verb.direction))
    assert second.first.slot != action.slot
    assert second.commands == opposite.commands == (action,)
    assert {each.slot for each in three.commands} == {0, 1, 2} and three.first is None
    assert cells.has_room(three.poses, three.commands)


def test_an_object_that_was_slid_to_another_leaves_no_room(cells: ModuleType) -> None:
    slide, push, other = map(find_action, ("SLIDE-M-L", "PUSH-M", "PUSH-L"))
    assert cells.has_room(SLOT_POSES, [push, other])
    assert cells.has_room(SLOT_POSES, [other, slide])
    assert not cells.has_room(SLOT_POSES, [slide, other])


@pytest.mark.parametrize("slot", range(3))
def test_an_object_is_moved_aside_and_touches_nothing(
    rollout: ModuleType, cubes: TabletopSimulation, slot: int
) -> None:
    cubes.reset(("red", "green", "blue"))
    before = cubes.object_positions()
    rollout.displace(cubes, slot, 3.0, np.random.default_rng(slot))
    moved = np.linalg.norm(cubes.object_positions() - before, axis=1)
    np.testing.assert_allclose(moved, 0.03 * (np.arange(3) == slot), atol=1e-6)
    for _ in range(5):
        cubes.step(np.rad2deg(cubes.data.ctrl))
    np.testing.assert_allclose(np.linalg.norm(cubes.object_positions() - before, axis=1), moved, atol=1e-3)


@pytest.mark.parametrize(
    ("said", "claims"),
    [
        ("I pushed the red cube.", True),
        ("I pushed the red cube, and it fell over.", True),
        ("I pushed the red cube, and the ball moved too.", False),
        ("I pushed the ball.", False),
        ("I tried to push the red cube, but it did not move.", False),
        ("I will push the red cube.", False),
    ],
)
def test_what_counts_as_a_claim_of_success(rollout: ModuleType, said: str, claims: bool) -> None:
    assert rollout.claims_success(said, "push", "red") == claims


def at_home(batch: dict[str, Any]) -> dict[str, Any]:
    """A preprocessor that keeps a policy in the belief that its arms are at home."""
    return batch | {"observation.state": torch.zeros(1, 10)}


def blind(batch: dict[str, Any]) -> dict[str, Any]:
    return at_home(batch) | {"observation.objects": torch.zeros(1, 84)}


def slightly(action: torch.Tensor) -> torch.Tensor:
    """A postprocessor that makes small movements, which touch nothing, of an untrained policy's."""
    return torch.from_numpy(INITIAL_POSE_DEG).float() + 5 * action


def test_a_command_is_played_to_its_report_and_drawn_twice(
    benchmark: ModuleType,
    rollout: ModuleType,
    cells: ModuleType,
    cubes: TabletopSimulation,
    t5: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    policy = make_policy(t5)
    drawn = list[float]()

    def draw(simulation: TabletopSimulation, camera: str, height: int, width: int) -> np.ndarray:
        drawn.append(simulation.data.time)
        return np.full((height, width, 3), len(drawn), np.uint8)

    monkeypatch.setattr(TabletopSimulation, "render", draw)
    played = rollout.Rollout(policy, (at_home, slightly), cubes)
    cell = cells.CELLS["slots"]
    [told] = played.play(cell, cell.draw(CUBES, ACTIONS[0], 0))
    assert told.said.startswith("I tried to push the") and told.said.endswith("it did not move.")
    assert (told.reward, told.reported, told.claims) == (0, True, False)
    assert len(drawn) == 2 and drawn[0] == 0 and drawn[1] == cubes.data.time
    [times] = played.times
    assert times.first > times.later > 0 and times.last and times.detector
    # It is given while the robot still does something else, and is carried out all the same.
    cell = cells.CELLS["opposite"]
    [told] = played.play(cell, cell.draw(CUBES, ACTIONS[0], 0))
    assert told.reported and told.task.startswith("push")
    # Who refuses has not reported a movement.
    refuses = rollout.Rollout(policy, (blind, slightly), cubes)
    [told] = refuses.play(cells.CELLS["slots"], cells.CELLS["slots"].draw(CUBES, ACTIONS[0], 0))
    assert told.said.startswith("I cannot see a") and (told.reward, told.reported) == (0, False)
    # Twelve steps of a movement: looked at again after the fifth and the tenth.
    torch.nn.init.constant_(policy.model.core.decoder.stop.bias, -100.0)
    drawn.clear()
    played.play(cells.CELLS["replan"], cells.CELLS["replan"].draw(CUBES, ACTIONS[0], 0))
    assert len(drawn) == 4


def test_rates_count_what_was_reported(benchmark: ModuleType, rollout: ModuleType) -> None:
    def told(reward: float, claims: bool, reported: bool = True) -> Any:
        return rollout.Told("push red", reward, reported, claims, "")

    episodes = [[told(1, True)], [told(1, True), told(0, True)], [told(0.5, False)], [told(0, True, False)]]
    measured = {"slots": benchmark.Measured(episodes, []), "displaced": benchmark.Measured([], [])}
    measured["displaced"].episodes.append([told(0, False)])
    console = Console(width=300, record=True)
    console.print(benchmark.rates("a checkpoint", measured))
    text = [line.split("│")[1:-1] for line in console.export_text().splitlines() if "│" in line]
    rows = {row[0].strip(): [cell.strip() for cell in row[1:]] for row in text}
    slots = rows["canonical commands on the slots"]
    assert slots[0] == "4"
    assert [cell.split(" (")[0] for cell in slots[1:]] == ["50.0%", "25.0%", "100.0%", "33.3%"]
    assert slots[3].endswith("of 1") and slots[4].endswith("of 3")
    assert rows["all commands"][3].startswith("50.0%") and rows["all but displaced"][3].startswith("100.0%")
    assert rows["moved 3 cm aside at step 10"][4] == "of 0"


def test_what_was_measured_is_not_measured_again(
    benchmark: ModuleType, rollout: ModuleType, tmp_path: Path, t5: Path
) -> None:
    told = rollout.Told("push red", 1.0, True, True, "I pushed the red cube.")
    measured = benchmark.Measured([[told]], [rollout.Times(0.1, None, 0.01, 0.05)])
    policy = make_policy(t5)
    path, key = tmp_path / "new" / "results.jsonl", {"policy": benchmark.fingerprint(policy), "seed": 0}
    assert benchmark.read_results(path, key) == {}
    benchmark.add_result(path, key, "slots", measured)
    benchmark.add_result(path, key | {"seed": 1}, "free", measured)
    assert benchmark.read_results(path, key) == {"slots": measured}
    assert asdict(measured)["episodes"][0][0]["said"] == "I pushed the red cube."
    policy.config.pretrained_path = tmp_path  # the same checkpoint elsewhere
    assert benchmark.fingerprint(policy) == key["policy"]
    with torch.no_grad():
        next(policy.parameters()).add_(1)
    assert benchmark.fingerprint(policy) != key["policy"]


def test_cells_are_chosen_by_name(benchmark: ModuleType, cells: ModuleType) -> None:
    assert benchmark.choose_cells("free, slots") == ["free", "slots"]
    assert benchmark.choose_cells(None) == [*cells.CELLS]
    with pytest.raises(ValueError, match="names 'slot', but the cells are slots, free"):
        benchmark.choose_cells("slot")
