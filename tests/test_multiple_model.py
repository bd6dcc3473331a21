"""Interacting multiple models: filterpy's, what they find of k and how fast, where they hold."""

import numpy as np
import pytest
from magnet_scale_cases import BEARING, jump, run

from ambkit import MultipleModelFilter


def test_a_jump_while_the_rotor_moves_far_is_found_in_ten_milliseconds():
    record = jump(1.3, 3e-4)
    scale = MultipleModelFilter(BEARING).run(record).scale
    assert np.abs(scale[record.t >= 1.01] / 1.3 - 1).max() < 0.1


def test_the_weights_are_probabilities():
    mine = MultipleModelFilter(BEARING)
    mine.run(run(3e-4))
    assert sum(mine.weights.values()) == pytest.approx(1.0, rel=1e-12)
    assert max(mine.weights, key=lambda scale: mine.weights[scale]) == 1.0
