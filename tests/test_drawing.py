# SPDX-License-Identifier: Apache-2.0
"""One thread draws for all who ask."""

import gc
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from nico_tabletop.objects import read_objects
from nico_tabletop.robot import EYES
from nico_tabletop.simulation import TabletopSimulation


def laid(objects: str) -> TabletopSimulation:
    simulation = TabletopSimulation(read_objects(objects))
    simulation.reset(tuple(simulation.objects)[:3])
    return simulation


def test_worlds_of_several_threads_draw_what_one_draws():
    sets, sizes = ("clant", "claeo") * 3, ((48, 64), (64, 48), (48, 64))
    alone = {objects: [laid(objects).render(EYES, *size) for size in sizes] for objects in {*sets}}

    def images(objects: str) -> list[np.ndarray]:
        simulation = laid(objects)
        drawn = [simulation.render(EYES, *size) for size in sizes]
        if objects == "clant":  # the others are left to the garbage collector
            simulation.close()
        return drawn

    with ThreadPoolExecutor(3) as threads:
        for objects, drawn in zip(sets, threads.map(images, sets), strict=True):
            for image, expected in zip(drawn, alone[objects], strict=True):
                np.testing.assert_array_equal(image, expected)


def test_a_closed_world_frees_what_drew_it_and_draws_again():
    simulation, other = laid("claeo"), laid("clant")
    before, others = (each.render(EYES, 48, 64) for each in (simulation, other))
    simulation.close()
    gc.collect()
    np.testing.assert_array_equal(other.render(EYES, 48, 64), others)
    np.testing.assert_array_equal(simulation.render(EYES, 48, 64), before)
    simulation.close()
    simulation.close()


def test_segmentation_leaves_the_next_image_as_it_was():
    simulation = laid("clant")
    before = simulation.render(EYES, 48, 64)
    simulation.segmented_boxes(EYES, 48, 64)
    np.testing.assert_array_equal(simulation.render(EYES, 48, 64), before)
