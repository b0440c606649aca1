"""The levels by which a first look decides, in one place.

Shares, correlations and confidences are compared with few levels: a first look asks whether something is there, and a
finer level would answer differently from record to record. Any other threshold is explained where it is used.
"""

from __future__ import annotations

SAME = 0.02
"""Numbers that differ by less are the same, and less than this share of the largest is zero: a timer can seldom be set
to exactly 10 ms, and sensors and converters have errors of a percent."""
PART = 0.1
"""A smaller share does not matter: no plot shows it."""
MOST = 0.9
"""A larger share than this is nearly all; signals with a higher correlation have nearly the same course."""
EXPLAINS, SUGGESTS = 0.5, 0.2
"""A linear model whose free run has a better fit than the first explains an output; with a better fit than the second
it explains a part of it. With a lower fit it is not used."""
UNSURE = 0.6
"""A guess of a lower confidence may well be wrong, and is mentioned as such."""
NAMED = 0.8
"""A name of at least this confidence says what a column is; below it, its unit and its numbers decide."""
CLEAR = 6.0
"""An effect of this many standard errors is significant: chance gives none in a hundred thousand lags."""
CHANCE = 1e-3
"""An effect with a lower probability by chance is significant. The level is far below 5 %, because the colour of the
noise is only estimated."""
JUMP = 12.0
"""A step this many times as large as usual is no ordinary one: it is an outlier, a reset or a new level."""
FEW = 3
"""Fewer occurrences may be accidental."""
FEWEST_SAMPLES = 50
"""A shorter record, or a shorter stretch of it, shows nothing about dynamics."""
SAMPLES, FEW_SAMPLES = 20_000, 4_000
"""At most this many samples, from the middle of a record, estimate a model, and compare several: more take time and
change no finding."""
LAGS = 4
"""Past inputs and past outputs in a linear regression, enough for a drive with a shaft or a filter."""
