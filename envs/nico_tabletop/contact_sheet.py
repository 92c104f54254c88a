# SPDX-License-Identifier: Apache-2.0
"""An image of sets of objects: `python -m nico_tabletop.contact_sheet my.yaml --output=sheet.png`."""

import argparse
import sys
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from .drawing import DrawingError
from .objects import SHIPPED, ObjectsError, read_objects
from .robot import EYES
from .simulation import TabletopSimulation

# Part of the eyes' image around an object on the middle slot: x0, y0, x1, y1 as fractions of its width and
# height, at the same scale for all objects.
_VIEW = (0.42, 0.245, 0.58, 0.585)
_IMAGE_SIZE = (1440, 1920)
_TILE = (160, 255)
_CAPTION = 24
_COLUMNS = 8


def tiles(source: str) -> list[tuple[str, Image.Image]]:
    """Name of each object of a set and its image on the middle slot, as the robot sees it."""
    simulation = TabletopSimulation(read_objects(source))
    names = list(simulation.objects)
    height, width = _IMAGE_SIZE
    x0, y0, x1, y1 = _VIEW
    found = []
    for index, name in enumerate(names):
        # Its neighbours stand outside the view.
        simulation.reset((names[index - 1], name, names[index - 2]))
        image = Image.fromarray(simulation.render(EYES, height, width))
        view = image.crop((round(x0 * width), round(y0 * height), round(x1 * width), round(y1 * height)))
        found.append((name, view.resize(_TILE, Image.Resampling.LANCZOS)))
    simulation.close()
    return found


def contact_sheet(sources: list[str]) -> Image.Image:
    """Every object of the sets with its name below it."""
    found = [tile for source in sources for tile in tiles(source)]
    (wide, high), rows = _TILE, -(-len(found) // _COLUMNS)
    sheet = Image.new("RGB", (min(len(found), _COLUMNS) * wide, rows * (high + _CAPTION)), "white")
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(15)
    for index, (name, image) in enumerate(found):
        left, top = index % _COLUMNS * wide, index // _COLUMNS * (high + _CAPTION)
        sheet.paste(image, (left, top))
        draw.text((left + wide / 2, top + high + _CAPTION / 2), name, "black", font, anchor="mm")
    return sheet


def main() -> None:
    """Draw each object as the robot sees it on the middle slot, with its name below."""
    parser = argparse.ArgumentParser(prog="python -m nico_tabletop.contact_sheet", description=main.__doc__)
    sets = f"shipped set ({', '.join(SHIPPED)}) or YAML file"
    parser.add_argument("objects", nargs="+", help=sets)
    parser.add_argument("--output", type=Path, required=True, help="PNG file to write")
    arguments = parser.parse_args()
    try:
        sheet = contact_sheet(arguments.objects)
    except (DrawingError, ObjectsError) as error:
        sys.exit(f"contact_sheet: {error}")
    # A palette makes the file three times smaller.
    sheet.quantize(256, kmeans=2).save(arguments.output, format="PNG", optimize=True)
    print(f"Contact sheet: {arguments.output}")


if __name__ == "__main__":
    main()
