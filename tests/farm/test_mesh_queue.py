import numpy as np
import pytest

from fractal_farm.farm.mesh_queue import MeshQueue
from fractal_farm.farm.work import MeshOrder
from fractal_farm.ifs.genome import Genome
from fractal_farm.solid import SolidParameters
from tests.table1 import TABLE1


def _order(number):
    genes = np.array(TABLE1["06582"])
    genes[0, 4] += number
    return MeshOrder(Genome(genes), SolidParameters(), ("glb",))


@pytest.fixture
def queue():
    queue = MeshQueue(3, 0.02)
    for number, (fitness, gap) in enumerate([(0.90, 0.5), (0.99, 0.5), (0.88, 0.01), (0.95, 0.02), (0.87, 0.0)]):
        queue.offer(_order(number), fitness, gap)
    return queue


def _taken(queue, progress):
    found = []
    while (order := queue.take(progress)) is not None:
        found.append(round(order.genome.genes[0, 4] - TABLE1["06582"][0][4]))
    return found


def test_printable_designs_come_first_then_the_fitter(queue):
    queue.limit = None
    assert _taken(queue, 1.0) == [3, 2, 4, 1, 0]


def test_the_budget_is_spent_in_step_with_the_run(queue):
    assert _taken(queue, 0.2) == []
    assert _taken(queue, 0.5) == [3]
    assert _taken(queue, 1.0) == [2, 4]
    assert _taken(queue, 1.0) == []


def test_nobody_is_meshed_twice(queue):
    queue.limit = None
    queue.skip(_order(9).genome.design_id)
    queue.offer(_order(9), 0.999, 0.0)
    queue.offer(_order(2), 0.88, 0.01)
    assert sorted(_taken(queue, 1.0)) == [0, 1, 2, 3, 4]


def test_a_lost_order_is_next_and_does_not_cost_the_budget(queue):
    first = queue.take(1.0)
    queue.again(first)
    assert queue.take(1.0) is first
    assert _taken(queue, 1.0) == [2, 4]


def test_many_offers_keep_the_best(queue):
    for number in range(10, 500):
        queue.offer(_order(number), 0.86 + number / 10_000, 0.0)
    assert _taken(queue, 1.0) == [3, 499, 498]
