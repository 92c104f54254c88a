# SPDX-License-Identifier: Apache-2.0
"""Sets of objects: those that are shipped, those of a user, and what is wrong with a file."""

import copy
import json
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from lerobot.datasets import LeRobotDataset
from lerobot.envs.configs import EnvConfig
from lerobot.envs.factory import make_env
from PIL import Image

from clant_claeo.demonstrations import from_release, scripted
from clant_claeo.release import Release
from clant_claeo.wordings import wordings
from commands import run, run_anyway
from lerobot_owlxt5.commands.parser import name_problem
from nico_tabletop.configuration import ClaeoEnvConfig
from nico_tabletop.contact_sheet import tiles
from nico_tabletop.env import NAME_BYTES, TabletopEnv
from nico_tabletop.objects import (
    CUBE_HALF_WIDTH,
    SHIPPED,
    ObjectsError,
    TabletopObject,
    read_objects,
    visible_surface,
)
from nico_tabletop.robot import EYES
from nico_tabletop.simulation import TabletopSimulation
from nico_tabletop.tasks import ACTIONS, find_action

DOCS = Path(__file__).parents[1] / "docs" / "objects.md"
HEIGHT, WIDTH = 240, 320
CORNERS = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1]])
TRIANGLES = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])


def write_stl(path: Path, millimetres: float) -> None:
    """A tetrahedron with right angles at its corner in the origin."""
    rows = np.zeros(len(TRIANGLES), dtype=[("numbers", "<f4", 12), ("attribute", "<u2")])
    rows["numbers"][:, 3:] = (millimetres * CORNERS[TRIANGLES]).reshape(-1, 9)
    path.write_bytes(bytes(80) + np.uint32(len(rows)).tobytes() + rows.tobytes())


def write_obj(path: Path, metres: float) -> None:
    lines = [f"v {x} {y} {z}" for x, y, z in metres * CORNERS]
    lines += [f"f {a} {b} {c}" for a, b, c in TRIANGLES + 1]
    path.write_text("\n".join(lines), encoding="utf-8")


@pytest.fixture(scope="module")
def toys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of the documentation, with its mesh."""
    folder = tmp_path_factory.mktemp("toys")
    (text,) = re.findall(r"```yaml\n(.+?)```", DOCS.read_text(), re.DOTALL)
    (folder / "toys.yaml").write_text(text)
    write_stl(folder / "duck.stl", 40)
    return folder / "toys.yaml"


def plain() -> dict[str, Any]:
    """Three objects without fault."""
    ball = {"sphere": {"radius": 0.02}, "position": [0, 0, 0.02], "color": [1, 0, 0]}
    stick = {"tube": {"path": [[0, 0.01], [0, 0.05]], "radius": 0.004}, "color": [0, 1, 0, 0.5]}
    dish = {"lathe": [[0.02, 0], {"arc": {"center": [0, 0.01], "radius": 0.02, "from": 0, "to": 90}}]}
    parts = ball, stick, dish | {"color": [0, 0, 1], "rotation": [0, 0, 45]}
    names = "marble", "stick", "dish"
    found = [
        {"name": name, "synonyms": [f"a {name}"], "parts": [part]}
        for name, part in zip(names, parts, strict=True)
    ]
    return {"objects": found}


def read(document: object, folder: Path) -> tuple[TabletopObject, ...]:
    path = folder / "set.yaml"
    path.write_text(document if isinstance(document, str) else yaml.safe_dump(document))
    return read_objects(path)


def test_the_papers_sets_have_their_objects_in_order():
    assert [item.name for item in read_objects("clant")] == [
        "blue",
        "cyan",
        "green",
        "red",
        "violet",
        "yellow",
    ]
    everyday = ["mustard bottle", "can", "mug", "white chess piece", "ball", "empty wine bottle"]
    assert [item.name for item in read_objects("claeo")] == everyday


def test_the_shipped_sets_share_no_name_and_all_names_fit():
    names = [item.name for name in SHIPPED for item in read_objects(name)]
    assert len(set(names)) == len(names) >= 6 + 6 + 12
    assert max(len(name.encode()) for name in names) <= NAME_BYTES


@pytest.mark.parametrize("shipped", SHIPPED)
def test_the_eyes_see_every_object_inside_its_box(shipped: str):
    simulation = TabletopSimulation(read_objects(shipped))
    names = list(simulation.objects)
    with mujoco.Renderer(simulation.model, HEIGHT, WIDTH) as renderer:
        for index, name in enumerate(names):
            simulation.reset((names[index - 1], name, names[index - 2]))
            box = simulation.object_boxes(WIDTH / HEIGHT)[1] * [WIDTH, HEIGHT, WIDTH, HEIGHT]
            with_it = simulation.render(EYES, HEIGHT, WIDTH).astype(int)
            renderer.enable_segmentation_rendering()
            renderer.update_scene(simulation.data, EYES)
            geoms = renderer.render()[..., 0]
            mine = np.flatnonzero(simulation.model.geom_bodyid == simulation.model.body(name).id)
            rows, columns = np.nonzero(np.isin(geoms, mine))
            seen = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
            assert np.abs(box - seen).max() <= 1.5, name
            simulation.data.joint(name).qpos[2] = -1  # under the floor
            mujoco.mj_forward(simulation.model, simulation.data)
            without = simulation.render(EYES, HEIGHT, WIDTH).astype(int)
            changed = np.abs(with_it - without).max(axis=2) > 20
            assert changed[rows, columns].mean() > 0.9, name
            assert len(rows) > 200, name
    simulation.close()


def test_the_shape_changes_nothing_but_the_looks():
    def pushed(source: str) -> np.ndarray:
        simulation = TabletopSimulation(read_objects(source))
        simulation.reset(tuple(simulation.objects)[:3])
        mass = [simulation.model.body(name).mass[0] for name in simulation.arrangement]
        simulation.data.joint(simulation.arrangement[0]).qvel[:2] = 0.5, 0.1
        for _ in range(3):
            simulation.step(simulation.joint_positions_deg)
        return np.array([*simulation.object_positions().ravel(), *mass])

    np.testing.assert_allclose(pushed("household"), pushed("clant"), atol=1e-9)


def test_the_documented_file_works_in_the_environment(toys: Path):
    env = TabletopEnv("PULL-M", str(toys), height=48, width=64)
    observation, _ = env.reset(options={"arrangement": ("basket", "rubber duck", "traffic cone")})
    assert env.task_description == "pull rubber duck"
    x0, y0, x1, y1 = observation["objects"].reshape(3, -1)[1, :4] * [64, 48, 64, 48]
    duck = (
        observation["pixels"][EYES][round(y0) : round(y1), round(x0) : round(x1)].reshape(-1, 3).astype(int)
    )
    assert (duck.max(axis=0) - duck.min(axis=0) > 40).any()
    env.close()


def test_lerobot_makes_environments_with_a_users_objects(toys: Path):
    config = ClaeoEnvConfig(task="PUSH-R", observation_height=48, observation_width=64, objects=str(toys))
    assert isinstance(config, EnvConfig)
    envs = make_env(config, n_envs=2)["toys"][ACTIONS.index(find_action("PUSH-R"))]
    envs.reset(seed=[1, 2])
    known = {f"push {item.name}" for item in read_objects(toys)}
    assert set(envs.call("task_description")) <= known
    envs.close()


def test_a_mesh_may_be_an_obj_and_scales_multiply(tmp_path: Path):
    write_obj(tmp_path / "wedge.obj", 4.0)
    document = plain()
    document["objects"][0] |= {
        "scale": 0.1,
        "parts": [{"mesh": {"file": "wedge.obj", "scale": 0.1}, "color": [1, 1, 1]}],
    }
    simulation = TabletopSimulation(read(document, tmp_path))
    points = visible_surface(simulation.model, "marble")
    np.testing.assert_allclose(np.ptp(points, axis=0), 0.04, rtol=1e-6)
    np.testing.assert_allclose(points.min(axis=0), [0, 0, -CUBE_HALF_WIDTH], atol=1e-8)


def write_textured_cube(folder: Path) -> None:
    """`cube.obj`, 4 cm wide on the table, whose texture's upper half is at its upper half: red over blue."""
    corners = [
        (x, y, z) for z in (0, 0.04) for x, y in ((-0.02, -0.02), (0.02, -0.02), (0.02, 0.02), (-0.02, 0.02))
    ]
    sides = [(k, (k + 1) % 4, (k + 1) % 4 + 4, k + 4) for k in range(4)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + ["vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"]
    for quad in [*sides, (3, 2, 1, 0), (4, 5, 6, 7)]:
        a, b, c, d = (f"{corner + 1}/{place}" for place, corner in enumerate(quad, 1))
        lines += [f"f {a} {b} {c}", f"f {a} {c} {d}"]
    (folder / "cube.obj").write_text("\n".join(lines))
    pixels = np.zeros((64, 64, 3), dtype=np.uint8)
    pixels[:32, :, 0] = pixels[32:, :, 2] = 255
    Image.fromarray(pixels).save(folder / "cube.png")


TEXTURED = {"mesh": {"file": "cube.obj", "texture": "cube.png"}}


def test_a_textured_mesh_is_drawn_with_its_texture(tmp_path: Path):
    write_textured_cube(tmp_path)
    read(change(*PART, to=TEXTURED), tmp_path)
    env = TabletopEnv("PUSH-M", str(tmp_path / "set.yaml"), HEIGHT, WIDTH)
    observation, _ = env.reset(options={"arrangement": ("stick", "marble", "dish")})
    x0, y0, x1, y1 = observation["objects"].reshape(3, -1)[1, :4] * [WIDTH, HEIGHT, WIDTH, HEIGHT]
    # The lower half of its box shows the side that faces the robot.
    side = observation["pixels"][EYES][round((y0 + y1) / 2) : round(y1) - 2, round(x0) + 4 : round(x1) - 4]
    env.close()
    (_, image), *_ = tiles(str(tmp_path / "set.yaml"))
    for pixels in (side.astype(int), np.array(image).astype(int)):
        red, blue = pixels[..., 0] - pixels[..., 2] > 80, pixels[..., 2] - pixels[..., 0] > 60
        assert min(red.mean(), blue.mean()) > 0.02
        assert np.nonzero(red)[0].mean() < np.nonzero(blue)[0].mean()


def test_a_colour_tints_a_texture(tmp_path: Path):
    write_textured_cube(tmp_path)
    (item, *_) = read(change(*PART, to=TEXTURED | {"color": [1, 0.5, 0.5, 0.5]}), tmp_path)
    assert item.parts[0].rgba == (1, 0.5, 0.5, 0.5)


ROBOSUITE = {
    "can": {"file": "can.obj", "texture": "soda.png", "height": 0.04},
    "milk": {"file": "milk.obj", "texture": "ceramic.png", "height": 0.068},
    "cereal": {"file": "cereal.obj", "texture": "cereal.png", "height": 0.075},
    "bread": {"file": "bread.obj", "texture": "bread.png", "height": 0.029},
    "lemon": {"file": "lemon.obj", "texture": "lemon.png", "height": 0.02},
    "bottle": {"file": "bottle.obj", "texture": "glass.png", "height": 0.065},
}


def test_the_meshes_of_others_are_drawn_with_their_textures(tmp_path: Path):
    """Robosuite's, where it is installed; the height is that of the mesh's origin over its foot."""
    assets = Path(pytest.importorskip("robosuite").__file__).parent / "models" / "assets"
    objects = [
        {
            "name": name,
            "synonyms": [f"other {name}"],
            "parts": [
                {
                    "mesh": {
                        "file": str(assets / "objects" / "meshes" / each["file"]),
                        "texture": str(assets / "textures" / each["texture"]),
                    },
                    "position": [0, 0, each["height"]],
                }
            ],
        }
        for name, each in ROBOSUITE.items()
    ]
    read({"objects": objects}, tmp_path)
    for name, image in tiles(str(tmp_path / "set.yaml")):
        height, width = image.height, image.width
        middle = image.crop((width // 2 - 20, height // 2, width // 2 + 20, height - 20))
        assert len(middle.getcolors(10_000) or range(10_000)) > 50, name


@pytest.mark.parametrize("name", ["it", "left", "please", "to go cup", "arrow up", "me", "or gate"])
@pytest.mark.parametrize("key", ["name", "synonyms"])
def test_a_name_that_no_command_can_have_is_refused(tmp_path: Path, name: str, key: str):
    with pytest.raises(ObjectsError) as caught:
        read(change(*FIRST, key, to=name if key == "name" else ["a marble", name]), tmp_path)
    place = (
        f"{tmp_path / 'set.yaml'}, object {name if key == 'name' else 'marble'!r}: {name!r} cannot be a name"
    )
    assert str(caught.value).startswith(place)
    assert f"the command 'push {name}' would not be understood" in str(caught.value)


@pytest.mark.parametrize("shipped", SHIPPED)
def test_commands_about_shipped_objects_are_understood(shipped: str):
    names = [name for item in read_objects(shipped) for name in (item.name, *item.synonyms)]
    assert [name_problem(name) for name in names] == len(names) * [""]


def change(*path: Any, to: Any) -> dict[str, Any]:
    """The faultless document with one value replaced, or removed if `to` is None."""
    document = plain()
    place: Any = document
    for key, _ in pairwise(path):
        place = place[key]
    if to is None:
        del place[path[-1]]
    else:
        place[path[-1]] = to
    return document


FIRST = ("objects", 0)
PART = (*FIRST, "parts", 0)


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ("objects: [", "no YAML file"),
        ("", "expected objects with values; got None"),
        ({"things": []}, "objects is missing"),
        (plain() | {"things": 1}, "things is not known here; there are objects"),
        (change("objects", 2, to=None), "list of 3 or more objects"),
        (change(*FIRST, "name", to=None), "object 1: name is missing"),
        (change(*FIRST, "name", to="stick"), "object 'stick': 'stick' is a name or synonym already"),
        (change(*FIRST, "synonyms", to=["dish"]), "object 'dish': 'dish' is a name or synonym already"),
        (change(*FIRST, "synonyms", to=[]), "synonyms: expected a list of 1 or more synonyms"),
        (change(*FIRST, "name", to="an extraordinarily long n"), "25 bytes in UTF-8, 24 fit"),
        (change(*FIRST, "name", to=""), "name: expected letters and digits"),
        (change(*FIRST, "name", to="salt, pepper"), "expected letters and digits with single spaces"),
        (change(*FIRST, "name", to=True), "name: expected words (in quotes"),
        (change(*FIRST, "weight", to=1), "object 'marble': weight is not known here"),
        (change(*FIRST, "scale", to="big"), "'marble', scale: expected a number such as 0.025; got 'big'"),
        (change(*FIRST, "scale", to=1000), "it is 4000 x 4000 x 4000 cm"),
        (change(*FIRST, "scale", to=0.1), "too small to be seen"),
        (change(*FIRST, "parts", to=[]), "parts: expected a list of 1 or more parts"),
        (change(*PART, "color", to=None), "part 1: color is missing"),
        (change(*PART, "color", to=[255, 0, 0]), "color, number 1: expected a number from 0 to 1; got 255"),
        (change(*PART, "color", to=[0, 0]), "color: expected [3 or 4 numbers]"),
        (change(*PART, "position", to=[0, 0, 0]), "it reaches 2 cm into the table"),
        (change(*PART, "position", to=[0, 0, float("nan")]), "position, number 3: expected a number"),
        (change(*PART, "position", to=[0.05, 0, 0.02]), "reaches 7 cm sideways from its middle and 4 cm up"),
        (change(*PART, "sphere", "radius", to=-1), "sphere, radius: expected a number from 0.0001"),
        (change(*PART, "sphere", to=None), "exactly one of lathe, tube, box, sphere"),
        (change(*PART, "box", to={"size": [1, 1, 1]}), "exactly one of lathe, tube, box, sphere"),
        (change(*PART, "mesh", to={"file": "x.obj"}), "exactly one of"),
        (change(*PART, to={"mesh": {"file": "gone.obj"}, "color": [1, 1, 1]}), "file: there is no file"),
        (change(*PART, to={"mesh": {"file": "a.blend"}, "color": [1, 1, 1]}), "name of an OBJ or STL file"),
        (change(*PART, to={"mesh": {"file": "set.obj"}, "color": [1, 1, 1]}), "MuJoCo cannot build it"),
        (change(*PART, to={"mesh": {"file": "set.obj"}}), "part 1: color is missing"),
        (change(*PART, to={"mesh": {"file": "set.obj", "texture": "gone.png"}}), "texture: there is no file"),
        (change(*PART, to={"mesh": {"file": "set.obj", "texture": "a.jpg"}}), "the name of a PNG file"),
        (change(*PART, to={"mesh": {"file": "set.obj", "texture": "set.png"}}), "has no texture coordinates"),
        (change(*PART, to={"mesh": {"file": "cube.obj", "texture": "set.png"}}), "MuJoCo cannot build it"),
        (change(*PART, to={"capsule": {"radius": 0.02, "height": 0.03}, "color": [1, 1, 1]}), "round ends"),
        (change("objects", 1, "parts", 0, "tube", "path", to=[[0, 0.01], [0, 0.01]]), "turns back on itself"),
        (change("objects", 1, "parts", 0, "tube", "path", to=[[0, 0.01]]), "two or more points"),
        (change("objects", 2, "parts", 0, "lathe", 0, to=[-0.02, 0]), "no radius may be negative"),
    ],
)  # fmt: skip
def test_a_fault_is_named_with_its_place(tmp_path: Path, document: object, message: str):
    write_textured_cube(tmp_path)
    for unreadable in ("set.obj", "set.png"):
        (tmp_path / unreadable).write_text("this is no mesh and no image")
    with pytest.raises(ObjectsError, match=re.escape(message)) as caught:
        read(document, tmp_path)
    assert str(tmp_path / "set.yaml") in str(caught.value)


def test_an_unknown_set_names_those_that_exist():
    with pytest.raises(ObjectsError, match=r"'kitchen'.*YAML file.*clant, claeo, household"):
        read_objects("kitchen")


def places(value: object, *path: Any) -> list[tuple[Any, ...]]:
    """Paths of all values inside a document."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(found for key, inner in items for found in places(inner, *path, key))]


ANYTHING = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(st.characters(codec="utf-8"), max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text("abc", max_size=2), inner, max_size=3)
    ),
    max_leaves=5,
)


@settings(max_examples=200)
@given(place=st.sampled_from(places(plain())[1:]), value=ANYTHING)
def test_whatever_stands_somewhere_is_read_or_refused(
    place: tuple[Any, ...], value: object, tmp_path_factory: pytest.TempPathFactory
):
    document = copy.deepcopy(plain())
    inner: Any = document
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    folder = tmp_path_factory.getbasetemp()
    try:
        items = read(document, folder)
    except ObjectsError as error:
        assert str(folder / "set.yaml") in str(error)
    else:
        TabletopSimulation(items).reset([item.name for item in items[:3]])


def test_commands_use_the_name_and_the_first_synonym():
    item = TabletopObject("mug", ("cup", "beaker"), ())
    assert wordings(find_action("PUSH-L"), item) == ("push mug", "move-up mug", "push cup", "move-up cup")


def test_larger_and_smaller_sets_are_demonstrated(toys: Path):
    found, again = list(scripted("household")), list(scripted("household"))
    arrangements = [demonstration.arrangement for demonstration in found]
    assert arrangements == [demonstration.arrangement for demonstration in again]
    assert (len(found), len(set(arrangements))) == (1440, 120)
    names = {item.name for item in read_objects("household")}
    assert all({arrangement[slot] for arrangement in arrangements} == names for slot in range(3))
    tests = [demonstration for demonstration in found if demonstration.split == "test"]
    assert len(tests) == 360
    assert len(list(scripted(str(toys)))) == 12 * 6


def test_six_objects_of_a_user_take_the_places_of_the_cubes(clant_release: Release, tmp_path: Path):
    document = plain()
    document["objects"] += [
        item | {"name": f"{item['name']} two", "synonyms": [f"second {item['name']}"]}
        for item in document["objects"]
    ]
    read(document, tmp_path)
    first = next(from_release(clant_release, str(tmp_path / "set.yaml")))
    cubes = next(from_release(clant_release))
    stand_ins = {
        cube.name: item["name"] for cube, item in zip(read_objects("clant"), document["objects"], strict=True)
    }
    assert first.arrangement == tuple(stand_ins[name] for name in cubes.arrangement)
    assert first.task == f"push {first.arrangement[0]}"
    assert first.joints is cubes.joints
    with pytest.raises(ValueError, match=r"6 objects, this set 19; .*--source=scripted"):
        next(from_release(clant_release, "household"))


@pytest.mark.slow
def test_importing_the_environments_reads_no_objects_and_builds_no_model():
    code = """if True:
        import sys
        from pathlib import Path
        import mujoco

        def fail(*args, **kwargs):
            raise AssertionError("a model was compiled")

        mujoco.MjModel.from_xml_string = mujoco.MjModel.from_xml_path = fail
        opened = []
        sys.addaudithook(lambda event, args: opened.append(str(args[0])) if event == "open" else None)
        import nico_tabletop.configuration as configuration
        folder = str(Path(configuration.__file__).parent)
        read = [path for path in opened if path.startswith(folder) and not path.endswith((".py", ".pyc"))]
        print("read:", [path for path in read if "__pycache__" not in path])
        try:  # and now both are noticed
            configuration.read_objects("clant")
        except AssertionError as error:
            print(error)
        print("then:", [Path(path).name for path in opened if path.endswith(".yaml")][-1])
    """
    lines = run("python", "-c", code).splitlines()
    assert lines[-3:] == ["read: []", "a model was compiled", "then: clant.yaml"]


@pytest.mark.slow
def test_the_builder_takes_a_users_objects(toys: Path, tmp_path: Path):
    root = tmp_path / "data"
    small = ("--arrangements=1", "--height=48", "--width=64", "--workers=1")
    output = run("owlxt5-dataset", f"--objects={toys}", f"--root={root}", *small)
    assert "of the scripted expert on toys" in output
    build = json.loads((root / "meta" / "build.json").read_text())
    assert (build["objects"], build["placement"]) == ("path/to/toys.yaml", "slots")
    card = (root / "README.md").read_text()
    assert "# TOYS: language and action" in card
    assert "owlxt5-dataset --objects=path/to/toys.yaml --arrangements=1" in card
    assert "pretrained_model --env.type=clant --env.objects=path/to/toys.yaml\n" in card
    assert str(toys.parent) not in card
    dataset = LeRobotDataset("local/toys", root=root, video_backend="pyav")
    assert {task.split(" ", 1)[1] for task in dataset.meta.tasks.index} == {
        item.name for item in read_objects(toys)
    }


@pytest.mark.slow
def test_the_builder_refuses_a_file_that_is_not_there(tmp_path: Path):
    done = run_anyway("owlxt5-dataset", "--objects=gone.yaml", f"--root={tmp_path / 'data'}")
    assert done.returncode == 1
    assert "cannot read objects from 'gone.yaml'" in done.stdout.splitlines()[-1]
    assert "Traceback" not in done.stdout


@pytest.mark.slow
def test_a_contact_sheet_shows_a_users_objects(toys: Path, tmp_path: Path):
    sheet = tmp_path / "sheet.png"
    run("python", "-m", "nico_tabletop.contact_sheet", toys, f"--output={sheet}")
    with Image.open(sheet) as image:
        pixels = np.array(image.convert("RGB"))
    thirds = np.split(pixels, 3, axis=1)
    assert not any(np.array_equal(one, other) for one, other in pairwise(thirds))
