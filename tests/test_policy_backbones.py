# SPDX-License-Identifier: Apache-2.0
import json
import shutil
from pathlib import Path

import pytest
import torch
from lerobot.configs import PreTrainedConfig
from torch.nn.functional import cross_entropy
from transformers import AutoModelForSeq2SeqLM, AutoTokenizer

from lerobot_owlxt5.backbones import small_t5 as backbones
from lerobot_owlxt5.backbones.language_model import SplitT5
from lerobot_owlxt5.backbones.zero_shot import ZeroShotDetector
from lerobot_owlxt5.modeling_crosst5 import CrossT5Policy
from lerobot_owlxt5.modeling_owlxt5 import OWLxT5Policy
from policy_helpers import EYES, make_config, make_dataset, make_owlv2, make_policy, make_t5, observe

CPU = torch.device("cpu")
TEXTS = ["push red", "", "slide to left greenish blue"]


@pytest.fixture(scope="module")
def t5(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_t5(tmp_path_factory.mktemp("t5"))


@pytest.mark.parametrize("text", ["push red", "Grüße aus Łódź: 日本", "execute: slide to left wine bottle"])
def test_the_tokenizer_spells_any_text(t5: Path, text: str) -> None:
    tokenizer = AutoTokenizer.from_pretrained(t5)
    tokens = tokenizer(text)["input_ids"]
    assert tokens[-1] == tokenizer.eos_token_id
    assert tokenizer.unk_token_id not in tokens
    assert tokenizer.decode(tokens, skip_special_tokens=True).strip() == text


def test_the_tokenizer_fits_the_dataset(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "data", episodes=2)
    tokenizer = AutoTokenizer.from_pretrained(make_t5(tmp_path / "t5", dataset.root))
    assert len(tokenizer("Translate English to German: The Commission met 1 times.")["input_ids"]) < 20


def test_the_command_says_what_to_do_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "t5"
    monkeypatch.setattr("sys.argv", ["backbones", f"--output_dir={folder}", "--d_model=32", "--num_layers=1"])
    backbones.main()
    assert f"--policy.language_model={folder}" in capsys.readouterr().out
    assert AutoModelForSeq2SeqLM.from_pretrained(folder, use_safetensors=True).config.d_model == 32
    monkeypatch.setattr("sys.argv", ["backbones", f"--output_dir={folder}", f"--dataset_root={tmp_path}"])
    with pytest.raises(SystemExit, match="holds no LeRobotDataset"):
        backbones.main()


def test_the_split_model_computes_what_t5_computes(t5: Path) -> None:
    language, whole = SplitT5(str(t5)), AutoModelForSeq2SeqLM.from_pretrained(t5).eval()
    prompts = ["execute: push red", "describe:", "repeat action:"]
    encoding, mask = language.encode(prompts, CPU)
    losses = language.text_loss(encoding, mask, TEXTS)
    for prompt, text, loss in zip(prompts, TEXTS, losses, strict=True):
        labels = language.tokenizer(text, return_tensors="pt")["input_ids"]
        output = whole(**language.tokenizer(prompt, return_tensors="pt"), labels=labels)
        assert loss.item() == pytest.approx(cross_entropy(output.logits[0], labels[0]).item(), abs=1e-4)
    texts = language.generate(encoding, mask, max_new_tokens=6)
    tokens = whole.generate(**language.tokenizer(prompts[:1], return_tensors="pt"), max_new_tokens=6)
    assert texts[0] == language.tokenizer.decode(tokens[0], skip_special_tokens=True).strip()


def test_a_prompt_is_encoded_once(t5: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    language = SplitT5(str(t5))
    encoded: list[str] = []

    def note(module: object, args: object, inputs: dict[str, torch.Tensor], output: object) -> None:
        encoded.extend(language.tokenizer.batch_decode(inputs["input_ids"], skip_special_tokens=True))

    language.model.get_encoder().register_forward_hook(note, with_kwargs=True)
    first = language.encode(["a", "b c", "a"], CPU)
    again = language.encode(["a", "b c", "d"], CPU)
    assert [text.strip() for text in encoded] == ["a", "b c", "d"]
    assert torch.equal(first[0][1, : first[1][1].sum()], again[0][1, : again[1][1].sum()])
    monkeypatch.setattr("lerobot_owlxt5.backbones.language_model.MAX_CACHED", 3)
    language.encode(["a", "e"], CPU)
    assert [text.strip() for text in encoded[3:]] == ["a", "e"], "a full cache begins anew"


def test_a_cached_encoding_is_the_same_in_any_company(t5: Path) -> None:
    """Else a resumed run, which begins with an empty cache, would not equal an unbroken one."""
    prompts = [
        "execute: push red",
        "describe: azure",
        "Translate English to German: Good morning, all of you.",
    ]
    together = SplitT5(str(t5)).encode(prompts, CPU)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        for prompt, encoding, mask in zip(prompts, *together, strict=True):
            assert torch.equal(SplitT5(str(t5)).encode([prompt], CPU)[0][0], encoding[mask])


def test_a_backbone_that_cannot_be_loaded_is_named(
    t5: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)
    with pytest.raises(
        OSError, match=r"--policy.language_model=no/where .* --policy.language_model=embedded:"
    ):
        make_policy(Path("no/where"))
    with pytest.raises(OSError, match=r"--policy.detector=no/where .*detector=embedded:"):
        make_policy(t5, detector="no/where")
    pickled = tmp_path / "pickled"
    pickled.mkdir()
    for path in t5.iterdir():
        if path.suffix != ".safetensors":
            (pickled / path.name).write_bytes(path.read_bytes())
    torch.save({}, pickled / "pytorch_model.bin")
    with pytest.raises(OSError, match=r"--policy\.language_model"):
        make_policy(pickled)


@pytest.mark.parametrize("offline", [True, False])
def test_without_network_one_message_names_all_backbones_and_nothing_is_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, offline: bool
) -> None:
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", offline)
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path))
    monkeypatch.setattr(
        "huggingface_hub.constants.HUGGINGFACE_CO_URL_TEMPLATE", "http://127.0.0.1:9/{repo_id}"
    )
    monkeypatch.setattr("lerobot_owlxt5.model.crossmodal_model.SplitT5", None)
    with pytest.raises(OSError, match="language_model=some/t5") as stopped:
        make_policy(Path("some/t5"), detector="some/owlv2")
    message = str(stopped.value)
    assert "--policy.detector=some/owlv2 (revision main) because:" in message
    assert "give --policy.language_model=embedded --policy.detector=embedded:" in message
    assert "\n" not in message
    assert stopped.value.__cause__ is None


@pytest.mark.slow
def test_models_of_the_real_sizes_run(tmp_path: Path) -> None:
    """T5-small and OWLv2-base with random weights: 60 and 155 million parameters."""
    small = backbones.SmallT5Config(
        tmp_path / "t5", vocab_size=1024, d_model=512, d_kv=64, d_ff=2048, num_layers=6, num_heads=8
    )
    backbones.make_small_t5(small, backbones.collect_texts(None))
    wide = {"hidden_size": 768, "intermediate_size": 3072, "num_hidden_layers": 12, "num_attention_heads": 12}
    owlv2 = make_owlv2(tmp_path / "owlv2", **wide, image_size=960, patch_size=16)
    config = make_config(tmp_path / "t5", detector=str(owlv2), score_threshold=0.0)
    assert config.camera is None
    detector = ZeroShotDetector(str(owlv2), None, 0.0, EYES)
    batch = observe(["push red"])
    assert detector(batch, [["red"]]).centre.shape == (1, 1, 2)
    language = SplitT5(str(tmp_path / "t5"))
    assert language.encode(["execute: push red"], CPU)[0].shape[2] == 512


def cache(folder: Path, name: str, model: Path, commit: str) -> None:
    """Lay a model into a folder as the Hub's client lays it into its cache."""
    place = folder / f"models--{name.replace('/', '--')}"
    shutil.copytree(model, place / "snapshots" / commit)
    (place / "refs").mkdir(exist_ok=True)
    (place / "refs" / "main").write_text(commit)


def test_a_checkpoint_names_the_commits_of_its_backbones(
    t5: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path / "cache"))
    owlv2 = make_owlv2(tmp_path / "owlv2")
    cache(tmp_path / "cache", "some/t5", t5, "1" * 40)
    cache(tmp_path / "cache", "some/owlv2", owlv2, "2" * 40)
    policy = make_policy(Path("some/t5"), detector="some/owlv2")
    policy.save_pretrained(tmp_path / "checkpoint")
    config = json.loads((tmp_path / "checkpoint" / "config.json").read_text())
    assert (config["language_model"], config["language_model_revision"]) == ("some/t5", "1" * 40)
    assert (config["detector"], config["detector_revision"]) == ("some/owlv2", "2" * 40)

    # The main branch goes on; the checkpoint does not.
    cache(tmp_path / "cache", "some/t5", make_t5(tmp_path / "t5"), "3" * 40)
    batch = observe(["push red"])
    loaded = OWLxT5Policy.from_pretrained(tmp_path / "checkpoint")
    assert torch.equal(loaded.predict_action_chunk(batch), policy.predict_action_chunk(batch))

    # On another machine: without them, and with one in a folder.
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path / "empty"))
    with pytest.raises(OSError, match=rf"--policy\.language_model=some/t5 \(revision {'1' * 40}\)"):
        OWLxT5Policy.from_pretrained(tmp_path / "checkpoint")
    there = [f"--language_model={t5}", f"--detector={owlv2}"]
    with pytest.raises(OSError, match=rf"--policy\.detector=some/owlv2 \(revision {'2' * 40}\)"):
        load(tmp_path / "checkpoint", there[:1])
    moved = load(tmp_path / "checkpoint", there)
    assert torch.equal(moved.predict_action_chunk(batch), policy.predict_action_chunk(batch))


def test_the_embedded_language_model_speaks_and_a_checkpoint_notes_which_it_was(tmp_path: Path) -> None:
    policy = make_policy(Path("embedded"))
    assert policy.model.language.model.dtype == torch.float32
    prompts = ["execute: move up the wug", "Translate English to German: Push the red cube to the left"]
    answers = policy.model.language.generate(*policy.model.language.encode(prompts, CPU), max_new_tokens=32)
    assert answers == ["push wug", "Schiebe den roten Würfel nach links"]

    policy.save_pretrained(tmp_path)
    batch = observe(["push red"])
    loaded = OWLxT5Policy.from_pretrained(tmp_path)
    assert torch.equal(loaded.predict_action_chunk(batch), policy.predict_action_chunk(batch))
    config = json.loads((tmp_path / "config.json").read_text())
    config["language_model_revision"] = "0" * 12
    (tmp_path / "config.json").write_text(json.dumps(config))
    with pytest.raises(ValueError, match=r"another embedded language model \(0{12}\).*train again"):
        OWLxT5Policy.from_pretrained(tmp_path)


def test_a_checkpoint_notes_which_embedded_detector_it_was_trained_with(t5: Path, tmp_path: Path) -> None:
    make_policy(t5, detector="embedded").save_pretrained(tmp_path)
    config = json.loads((tmp_path / "config.json").read_text())
    assert len(config["detector_revision"]) == 12
    assert 0 < OWLxT5Policy.from_pretrained(tmp_path).visual.detector.threshold < 1
    config["detector_revision"] = "0" * 12
    (tmp_path / "config.json").write_text(json.dumps(config))
    with pytest.raises(ValueError, match=r"another embedded detector \(0{12}\).*train again"):
        OWLxT5Policy.from_pretrained(tmp_path)


def test_another_backbone_is_not_asked_for_the_revision_of_the_one_that_it_replaces(
    t5: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path / "cache"))
    cache(tmp_path / "cache", "some/owlv2", make_owlv2(tmp_path / "owlv2"), "2" * 40)
    make_policy(t5, detector="embedded").save_pretrained(tmp_path / "embedded")
    from_the_hub = load(tmp_path / "embedded", ["--detector=some/owlv2"])
    assert from_the_hub.config.detector_revision == "2" * 40
    from_the_hub.save_pretrained(tmp_path / "hub")
    assert len(load(tmp_path / "hub", ["--detector=embedded"]).config.detector_revision or "") == 12


@pytest.mark.parametrize("name", ["./nowhere", "outputs/my/owl", "/no/such/folder"])
def test_a_folder_that_is_not_there_is_named(t5: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)
    with pytest.raises(OSError, match=rf"--policy\.detector={name} \(revision main\) because"):
        make_policy(t5, detector=name)


def test_a_checkpoint_of_another_policy_is_refused(t5: Path, tmp_path: Path) -> None:
    make_policy(t5).save_pretrained(tmp_path)
    with pytest.raises(ValueError, match=r"holds the policy 'owlxt5', not 'crosst5'"):
        CrossT5Policy.from_pretrained(tmp_path)


def load(checkpoint: Path, overrides: list[str]) -> OWLxT5Policy:
    """Load a checkpoint as `--policy.path` does, with options that follow it."""
    config = PreTrainedConfig.from_pretrained(checkpoint, cli_overrides=overrides)
    return OWLxT5Policy.from_pretrained(checkpoint, config=config)
