# SPDX-License-Identifier: Apache-2.0
"""Lets a policy do everything it can do with each episode, and keeps what `metrics` needs of it."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from lerobot.datasets import LeRobotDataset
from lerobot.processor import PolicyProcessorPipeline
from lerobot.utils.collate import lerobot_collate_fn
from lerobot.utils.constants import ACTION, OBS_PREFIX, OBS_STATE
from torch import Tensor
from torch.utils.data import DataLoader, Subset
from tqdm import tqdm

from ..commands.parser import named_objects, parse_command, plain, spoken
from ..commands.prompts import translate_prompt
from ..commands.pseudo_names import rename_object
from ..commands.replies import NOTHING_KNOWN, NOTHING_MOVED
from ..data.episode_store import EpisodeStore, EpisodeTexts
from ..data.windows import recover_actions
from . import metrics
from .report import Row
from .rewording import COMMAND_KINDS, LABEL_KINDS, reword_command, reword_labels

MODES = ("execute", "repeat action", "describe", "repeat language", "translate", "T5 alone")
AS_TRAINED = "dataset"

type Processor = PolicyProcessorPipeline[Any, Any]


class Scores:
    """What is known of each episode, by mode and variant."""

    def __init__(self) -> None:
        self._columns: dict[tuple[str, str], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))

    def add_texts(
        self, mode: str, variant: str, predictions: Sequence[str], references: Sequence[Sequence[str]]
    ) -> None:
        """Compare texts with the accepted ones of their episodes."""
        columns = self._columns[mode, variant]
        for text, accepted in zip(predictions, references, strict=True):
            columns["bleu2"].append(100 * metrics.bleu2(text, accepted))
            columns["accuracy"].append(100 * metrics.is_accepted(text, accepted))

    def add_movements(
        self, mode: str, variant: str, planned: Tensor, true: Tensor, lengths: Tensor, moves: Sequence[bool]
    ) -> None:
        """Compare plans with the true actions, both (batch, L, joints) in the dataset's unit.

        The stop is compared where a plan `moves`.
        """
        columns = self._columns[mode, variant]
        plan, truth, steps = planned.double().numpy(), true.double().numpy(), lengths.numpy()
        columns["squared_error"] += metrics.squared_errors(plan, truth, steps).tolist()
        columns["numbers"] += (steps * truth.shape[2]).tolist()
        off = np.abs(metrics.steps_until_still(planned.numpy()) - steps)
        columns["steps_off"] += off[np.array(moves)].tolist()

    def add_refused(self, mode: str, variant: str, refused: Iterable[bool]) -> None:
        """Note in which episodes the policy declined."""
        self._columns[mode, variant]["refused"] += [100.0 * each for each in refused]

    def rows(self, joint_range: float, seed: int) -> list[Row]:
        """The figures with their intervals.

        Args:
            joint_range: max - min of the joints over the whole dataset, in its unit.
            seed: Seed of the bootstrap.
        """
        rows = []
        for (mode, variant), lists in sorted(self._columns.items(), key=lambda item: MODES.index(item[0][0])):
            columns = {name: np.array(values) for name, values in lists.items() if values}
            figures: dict[str, metrics.Estimate] = {
                name: metrics.bootstrap(metrics.mean, columns[name], seed=seed)
                for name in ("bleu2", "accuracy", "refused", "steps_off")
                if name in columns
            }
            if "squared_error" in columns:
                figures["nrmse"] = metrics.bootstrap(
                    lambda errors, numbers: metrics.nrmse(errors, numbers, joint_range),
                    columns["squared_error"],
                    columns["numbers"],
                    seed=seed,
                )
            rows.append(Row(mode, variant, figures))
        return rows


@torch.no_grad()
def score_policy(
    policy: Any,
    preprocessor: Processor,
    postprocessor: Processor,
    dataset: LeRobotDataset,
    *,
    batch_size: int,
    robustness: bool,
    seed: int,
) -> Scores:
    """Score a policy in all modes that it was trained in, with each episode once.

    Args:
        policy: owlxt5 or crosst5.
        preprocessor: Its preprocessor.
        postprocessor: Its postprocessor.
        dataset: The chosen episodes, with windows from each first frame over the whole episode.
        batch_size: Episodes at once.
        robustness: Repeat execute and describe with words that are not in the dataset.
        seed: Seed of these words.
    """
    modes = {mode for mode in policy.config.modes if policy.config.was_trained_in(mode)}
    texts = EpisodeStore(dataset.meta).texts
    names = named_objects(dataset.meta.tasks.index)
    labels = {AS_TRAINED: dict(zip(names, names, strict=True))}
    # Only a detector looks for labels: elsewhere it makes no difference how they are worded.
    for kind in LABEL_KINDS if robustness and policy.visual.names_objects else ():
        labels[kind] = reword_labels(names, kind, texts, np.random.default_rng(seed))
    scores = Scores()
    first_frames = np.flatnonzero(dataset.hf_dataset.data.column("frame_index").to_numpy() == 0)
    frames = Subset(dataset, first_frames.tolist())
    with tqdm(total=len(first_frames), desc="Evaluating", unit="episode") as bar:
        for raw in DataLoader(frames, batch_size, collate_fn=lerobot_collate_fn):
            tasks: list[str] = raw["task"]
            episodes = raw["episode_index"].flatten().tolist()
            said = [texts.get(episode, EpisodeTexts()) for episode in episodes]
            said = [
                replace(each, wordings=each.wordings or (task,))
                for each, task in zip(said, tasks, strict=True)
            ]
            commands = {AS_TRAINED: tasks} if "execute" in modes else {}
            for kind in COMMAND_KINDS if commands and robustness else ():
                # Of each episode's own generator: the same words whatever the split and the batch size.
                commands[kind] = [
                    reword_command(task, kind, np.random.default_rng((seed, episode)))
                    for task, episode in zip(tasks, episodes, strict=True)
                ]
            true, lengths = recover_actions(raw[ACTION], raw["action_is_pad"])
            batch = preprocessor(raw)

            # As lerobot-eval hands it over, at the beginning and without a time axis.
            start = {key: value[:, 0] for key, value in batch.items() if key.startswith(OBS_PREFIX)}
            pose = start[OBS_STATE].clamp(-1.0, 1.0)
            for variant, wordings in commands.items():
                plan = policy.predict_action_chunk(start | {"task": wordings})
                # What is refused leaves the robot in exactly the pose that it is in.
                moves = (plan != pose[:, None]).any(dim=(1, 2)).tolist()
                scores.add_movements("execute", variant, postprocessor(plan).cpu(), true, lengths, moves)
                scores.add_refused("execute", variant, (not each for each in moves))
            if "repeat_action" in modes:
                plan = postprocessor(policy.repeat_action(batch)).cpu()
                scores.add_movements("repeat action", AS_TRAINED, plan, true, lengths, [True] * len(plan))
            for variant, names_of in labels.items() if "describe" in modes else ():
                descriptions = policy.describe(batch, labels=list(names_of.values()))
                references = [
                    accepted_descriptions(each.wordings, names_of[parse_command(task).object])
                    for each, task in zip(said, tasks, strict=True)
                ]
                scores.add_texts("describe", variant, descriptions, references)
                scores.add_refused(
                    "describe", variant, (text in (NOTHING_MOVED, NOTHING_KNOWN) for text in descriptions)
                )
            if "repeat_language" in modes:
                sentences = [spoken(task) for task in tasks]
                repeated = policy.repeat_language(sentences, batch)
                scores.add_texts("repeat language", AS_TRAINED, repeated, [[each] for each in sentences])
            if "translate" in modes:
                _score_translations(scores, policy, batch, said)
            bar.update(len(episodes))
    return scores


def accepted_descriptions(wordings: Sequence[str], label: str) -> list[str]:
    """The accepted wordings, and the same with the object called as the detector was told to call it."""
    names = dict.fromkeys([label, plain(label)])
    renamed = [rename_object(wording, name) for wording in wordings for name in names]
    return [spoken(wording) for wording in [*wordings, *renamed]]


def _score_translations(
    scores: Scores, policy: Any, batch: dict[str, Any], texts: Sequence[EpisodeTexts]
) -> None:
    """Against the language model's own output, which is what the policy learns, and against the dataset."""
    sentences = [each.sentence for each in texts if each.sentence is not None]
    if len(sentences) < len(texts):
        return
    device = batch[OBS_STATE].device
    prompts = [translate_prompt(sentence) for sentence in sentences]
    language = policy.model.language
    alone = language.generate(*language.encode(prompts, device), policy.config.max_text_tokens)
    translated = policy.translate(sentences, batch)
    references = [[each.translation or ""] for each in texts]
    scores.add_texts("translate", "vs. T5 alone", translated, [[text] for text in alone])
    scores.add_texts("translate", "vs. dataset", translated, references)
    scores.add_texts("T5 alone", "vs. dataset", alone, references)
