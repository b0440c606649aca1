"""The simulated plants that verdicts are judged on are what they are said to be."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from independent.supported import LOWER, PLANTS, REST, Plant, heating, late, shaft, solved

ONE = np.ones(8)
SIMULATED = {name: plant for name, plant in PLANTS.items() if isinstance(plant, Plant)}


def test_there_are_enough_kinds_and_each_is_judged_on_another_kind_of_input():
    assert len(PLANTS) >= 25
    assert all(plant.fitted is not plant.judged for plant in SIMULATED.values())


@pytest.mark.parametrize("name", ["motor", "encoder", "electrical time constant", "linear, coloured", "tanks"])
def test_records_of_a_seed_are_the_same_and_begin_at_rest(name):
    plant = PLANTS[name]
    first, again, other = plant.pair(3), plant.pair(3), plant.pair(4)
    np.testing.assert_array_equal(first.fitted.output, again.fitted.output)
    assert np.any(first.fitted.output != other.fitted.output)
    for record, size in ((first.fitted, 1.0), (first.unseen, LOWER)):
        assert len(record) == plant.samples
        assert np.all(record.input[:REST] == plant.centre)
        assert np.abs(record.input - plant.centre).max() <= size * plant.amplitude * (1 + 1e-12)
    assert 0 < first.noise < 0.2 * np.std(first.unseen.output)


def test_linear_plants_are_linear():
    rng = np.random.default_rng(0)
    u, v = rng.standard_normal((2, 200))
    for run in (heating, late):
        np.testing.assert_allclose(run(2 * u - v, 1.0, ONE), 2 * run(u, 1.0, ONE) - run(v, 1.0, ONE), atol=1e-9)


def test_the_integration_is_that_of_a_held_input():
    u = np.random.default_rng(0).standard_normal(300)
    b, a, _ = cont2discrete(([1.0], [0.1, 1.0]), 0.01)
    found = solved(lambda x, now: [(now - x[0]) / 0.1], [0.0], u, 0.01, 4)[:, 0]
    np.testing.assert_allclose(found, lfilter(b.ravel(), a, u), atol=1e-9)


def test_two_masses_resonate_where_they_should():
    for frequency, dt in ((18.0, 5e-3), (60.0, 2e-3)):
        u = 12 + 2 * np.random.default_rng(1).choice([-1.0, 1.0], 2200)  # never at standstill
        speed = shaft(u, dt, ONE, frequency)[700:]
        spectra = [np.abs(np.fft.rfft(np.hanning(1500) * (each - each.mean()))) for each in (speed, u[700:])]
        gain = np.convolve(spectra[0] / spectra[1].mean(), np.ones(15) / 15, "same")
        axis = np.fft.rfftfreq(1500, dt)
        near = (axis > 0.7 * frequency) & (axis < 1.4 * frequency)
        assert axis[near][np.argmax(gain[near])] == pytest.approx(frequency, rel=0.06)
