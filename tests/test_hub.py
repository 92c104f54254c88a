# SPDX-License-Identifier: Apache-2.0
"""Pushing datasets to the Hub and loading them from there, against a stand-in on the loopback device."""

import json
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from huggingface_hub import DatasetCard
from lerobot.datasets import LeRobotDataset
from PIL import Image

from clant_claeo.card import Build, write_card
from commands import run, run_anyway
from hub_server import TOKEN, HubServer, Repository

pytestmark = pytest.mark.slow  # starts commands

SMALL = ("--objects=claeo", "--arrangements=1", "--height=48", "--width=64")
PUSH = ("--push_to_hub=true", "--repo_id=me/claeo")


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("hub") / "claeo"
    run("owlxt5-dataset", *SMALL, f"--root={root}")
    return root


@pytest.fixture
def root(built: Path, tmp_path: Path) -> Path:
    return shutil.copytree(built, tmp_path / "claeo")


@pytest.fixture
def hub() -> Iterator[HubServer]:
    with HubServer() as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture
def online(hub: HubServer, tmp_path: Path) -> dict[str, str]:
    """The environment of a user of this Hub with nothing in any cache."""
    return {
        "HF_ENDPOINT": hub.url,
        "HF_HOME": str(tmp_path / "home"),
        "HF_HUB_DISABLE_XET": "1",
        "HF_HUB_OFFLINE": "0",
        "HF_TOKEN": TOKEN,
    }


def files(folder: Path) -> dict[str, bytes]:
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def fails(root: Path, online: dict[str, str], *options: str, command: tuple[str, ...] = ()) -> str:
    """The one message of a push that does not succeed."""
    done = run_anyway(*(command or ("owlxt5-dataset",)), *SMALL, f"--root={root}", *PUSH, *options, **online)
    assert done.returncode == 1
    assert "Traceback" not in done.stdout
    assert TOKEN not in done.stdout
    # The bar of a file that was under way may end after it.
    [message] = [line for line in done.stdout.splitlines() if line.startswith("owlxt5-dataset: ")]
    return message


def test_what_is_pushed_loads_again(root: Path, hub: HubServer, online: dict[str, str], tmp_path: Path):
    output = run("owlxt5-dataset", *SMALL, f"--root={root}", *PUSH, **online)
    assert f"Uploaded: {hub.url}/datasets/me/claeo" in output
    repository = hub.repositories["me/claeo"]
    assert not repository.private
    assert len(repository.commits) == 2  # all in one
    assert repository.tags == {"v3.0": 1}
    assert repository.commits[-1] == files(root) | {".gitattributes": b""}

    copy = tmp_path / "copy"
    script = f"""if True:
        import shutil
        from lerobot.datasets import LeRobotDataset
        dataset = LeRobotDataset("me/claeo", video_backend="pyav")
        assert len(dataset) and dataset[0]["observation.images.eyes"].shape == (3, 48, 64)
        shutil.copytree(dataset.root, {str(copy)!r})
    """
    output += run("python", "-c", script, **online)
    loaded, local = (LeRobotDataset("me/claeo", root=folder, video_backend="pyav") for folder in (copy, root))
    assert loaded.hf_dataset[:].keys() == local.hf_dataset[:].keys()
    for key in ("observation.state", "action", "observation.objects"):
        np.testing.assert_array_equal(loaded.hf_dataset[key], local.hf_dataset[key])
    assert files(copy) == repository.commits[-1]

    assert TOKEN not in output
    assert not [name for name, content in files(tmp_path).items() if TOKEN.encode() in content]


def test_another_push_leaves_nothing_of_the_first(root: Path, hub: HubServer, online: dict[str, str]):
    hub.repositories["me/claeo"] = Repository(
        private=False,
        commits=[{"data/chunk-000/file-007.parquet": b"old", "notes.txt": b"mine"}],
        tags={"v3.0": 0},
    )
    run("owlxt5-dataset", *SMALL, f"--root={root}", *PUSH, **online)
    repository = hub.repositories["me/claeo"]
    assert repository.commits[-1] == files(root) | {"notes.txt": b"mine"}
    assert repository.tags == {"v3.0": 1}


def test_an_interrupted_upload_is_repeated(root: Path, hub: HubServer, online: dict[str, str]):
    hub.accepts = 2
    # The client's pauses between its attempts are 23 s in all.
    hasty = "import time; time.sleep = lambda seconds: None; from clant_claeo.cli import main; main()"
    message = fails(root, online, command=("python", "-c", hasty))
    assert "me/claeo was not uploaded" in message
    assert "the same command" in message
    assert len(hub.repositories["me/claeo"].commits) == 1  # nothing of it is to be seen
    assert hub.repositories["me/claeo"].tags == {}

    hub.accepts = None
    run("owlxt5-dataset", *SMALL, f"--root={root}", *PUSH, **online)
    assert hub.repositories["me/claeo"].commits[-1] == files(root) | {".gitattributes": b""}
    assert len(hub.received) == len(set(hub.received))  # no file came twice


@pytest.mark.parametrize(
    ("options", "environment", "message"),
    [
        ((), {"HF_TOKEN": ""}, "there is no token for the Hub: run `hf auth login`, or set HF_TOKEN"),
        ((), {"HF_TOKEN": "hf_wrong"}, "the Hub does not know the token"),
        (("--repo_id=you/claeo",), {}, "the token may not write to you/claeo"),
        (("--repo_id=claeo",), {}, "needs --repo_id=<your name on the Hub>/claeo"),
        (
            ("--height=64",),
            {},
            "holds what another command made: owlxt5-dataset --objects=claeo --arrangements=1",
        ),
        ((), {"HF_ENDPOINT": "http://127.0.0.1:9"}, "me/claeo was not uploaded ("),
        ((), {"HF_HUB_OFFLINE": "1"}, "HF_HUB_OFFLINE"),
    ],
)
def test_what_the_hub_does_not_take(
    root: Path,
    hub: HubServer,
    online: dict[str, str],
    options: tuple[str, ...],
    environment: dict[str, str],
    message: str,
):
    assert message in fails(root, online | environment, *options)
    assert hub.received == []


def test_a_token_is_checked_before_anything_is_built(hub: HubServer, online: dict[str, str], tmp_path: Path):
    root = tmp_path / "new" / "claeo"
    assert "does not know the token" in fails(root, online | {"HF_TOKEN": "hf_wrong"})
    assert not root.parent.exists()


def test_a_private_data_set_is_not_pushed_where_all_can_read(
    root: Path, hub: HubServer, online: dict[str, str]
):
    hub.repositories["me/claeo"] = Repository(private=False)
    assert "exists and is public" in fails(root, online, "--private=true")
    assert hub.received == []


def test_the_card_tells_a_person_what_it_is(root: Path):
    card = DatasetCard.load(root / "README.md")
    assert card.data.license == "apache-2.0"
    for text in ("Simulated", "12 episodes", "train | 0 to 8", "test | 9 to 11", "seed, 0 unless"):
        assert text in card.text
    assert "owlxt5-dataset --objects=claeo --arrangements=1 --height=48 --width=64\n" in card.text
    assert str(root.parent) not in card.text
    assert "Quirks of the release" not in card.text
    for column in json.loads((root / "meta" / "info.json").read_text())["features"]:
        assert f"| `{column}` |" in card.text
    image = np.asarray(Image.open(root / "preview.jpg"))
    assert image.shape == (4 * 184 - 4, 4 * 244 - 4, 3)
    assert image.std() > 10


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_the_card_is_the_same_in_every_locale(root: Path, encoding: str):
    card = (root / "README.md").read_bytes()
    assert "58°" in card.decode("utf-8")
    (root / "README.md").unlink()
    # Few machines have a Latin-1 locale: Python asks this function for the encoding.
    code = f"""if True:
        import builtins, io, pathlib
        from pathlib import Path
        from clant_claeo.card import read_build, write_card
        builtin_open = io.open
        def as_the_locale_says(file, mode="r", buffering=-1, encoding=None, *rest, **named):
            given = encoding if encoding not in (None, "locale") or "b" in mode else {encoding!r}
            return builtin_open(file, mode, buffering, given, *rest, **named)
        io.open = builtins.open = as_the_locale_says
        root = Path({str(root)!r})
        write_card(root, "local/claeo", read_build(root))
    """
    run("python", "-c", code, LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0")
    assert (root / "README.md").read_bytes() == card


def test_the_card_never_licenses_the_releases_data(root: Path):
    command = "owlxt5-dataset --objects=claeo --source=path/to/CLANT"
    write_card(root, "me/claeo", Build("claeo", "slots", True, command))
    card = DatasetCard.load(root / "README.md")
    assert card.data.license == "other"
    assert card.data.license_name == "not-stated-by-its-authors"
    assert "**Not stated.**" in card.text
    assert "Quirks of the release" in card.text


def test_what_is_made_from_the_release_is_private(
    clant_dir: Path, hub: HubServer, online: dict[str, str], tmp_path: Path
):
    options = ("--objects=clant", f"--source={clant_dir}", "--arrangements=1", "--height=48", "--width=64")
    output = run(
        "owlxt5-dataset",
        *options,
        f"--root={tmp_path / 'clant'}",
        "--push_to_hub=true",
        "--repo_id=me/clant",
        **online,
    )
    repository = hub.repositories["me/clant"]
    assert repository.private
    assert "It is private: the release states no licence" in output
    card = repository.commits[-1]["README.md"].decode()
    assert "license: other" in card
    assert "--source=path/to/CLANT" in card
    assert str(clant_dir) not in card
