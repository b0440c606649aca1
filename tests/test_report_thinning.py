"""Lines of a report: thinned without losing extremes, and not drawn across gaps."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from emsid.report import views
from emsid.report.paths import thin
from emsid.report.views.conventions import timeline
from report_examples import COMPARISONS, drive, with_gaps

values = st.floats(-1e6, 1e6) | st.just(np.nan)


@settings(deadline=None)
@given(arrays(float, st.integers(1, 500), elements=values), st.integers(6, 200))
def test_thinning_keeps_ends_extremes_order_and_gaps(y, limit):
    x = np.arange(len(y), dtype=float)
    kept, thinned = thin(x, y, limit)
    assert len(kept) <= max(limit, 6) or len(y) <= limit
    assert (kept[0], kept[-1]) == (0, len(y) - 1)
    assert np.all(np.diff(kept) > 0)
    assert np.array_equal(thinned, y[kept.astype(int)], equal_nan=True)
    if not np.isnan(y).all():
        assert np.nanmin(thinned) == np.nanmin(y)
        assert np.nanmax(thinned) == np.nanmax(y)
    assert np.isnan(thinned).any() == np.isnan(y).any()


def test_thinning_keeps_the_envelope():
    x = np.linspace(0, 60, 300_000)
    y = np.sin(200 * x) * np.sin(x)
    kept, thinned = thin(x, y, 4000)
    assert len(kept) <= 4000
    bucket = 60 / 1999
    for start in np.arange(1, 59, 0.37):
        inside = y[(x >= start) & (x < start + 0.3)]
        near = thinned[(kept >= start - bucket) & (kept < start + 0.3 + bucket)]
        assert near.min() <= inside.min()
        assert near.max() >= inside.max()


def test_no_line_is_drawn_across_a_gap_after_thinning():
    y = np.arange(10_000.0)
    y[3000:3003] = y[7000] = np.nan
    kept, thinned = thin(np.arange(10_000.0), y, 400)
    for gap in (3001, 7000):
        between = (kept >= gap - 1) & (kept <= gap + 1)
        assert np.isnan(thinned[between]).any()


def test_a_record_in_pieces_is_drawn_with_gaps():
    record = with_gaps()
    pieces = len(record.segments)
    best = COMPARISONS["with gaps"].best
    run = views.measured_and_simulated(best).plots
    starting = np.count_nonzero(~best.simulation.counted)
    assert starting >= pieces
    measured = [*(line for plot in views.inputs([record]).plots for line in plot.marks), run[0].marks[0]]
    for line in measured:
        assert np.count_nonzero(np.isnan(line.y)) == pieces - 1
    for line in (run[0].marks[1], run[1].marks[0]):  # without the samples that start the model
        assert np.count_nonzero(np.isnan(line.y)) == pieces - 1 + starting
    for line in (*measured, run[0].marks[1], run[1].marks[0]):
        assert np.all(np.diff(line.x) > 0)
        assert len(line.x) == len(record) + pieces - 1


def test_a_gap_lies_where_the_samples_are_missing():
    record = drive(100).mask((np.arange(100) >= 40) & (np.arange(100) < 60))
    time, samples = timeline(record)
    assert 0.39 < time[samples == -1].item() < 0.60
    assert np.allclose(time[samples >= 0], record.time)
