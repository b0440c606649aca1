"""Numbers, units and names as the text of tables, captions and axes."""

from __future__ import annotations

import re
from collections.abc import Iterable
from math import floor, isfinite, isnan, log10


def number(value: float) -> str:
    """Four digits; a dash for what is not a finite number.

    >>> number(1.52216e-05), number(1234567.0), number(0.5)
    ('1.522e-5', '1.235e6', '0.5')
    """
    return _short(f"{value:.4g}") if isfinite(value) else "–"


def _short(digits: str) -> str:
    """A number without the sign and the zeros that its exponent does not need."""
    return re.sub(r"e([+-])0*", lambda e: "e" + e[1].strip("+"), digits)


def estimate(value: float, half_width: float) -> str:
    """The significant digits given by the interval and one more, at most eight."""
    if not value or not half_width:
        return _short(f"{value:.8g}")
    digits = floor(log10(abs(value))) - floor(log10(half_width)) + 2
    return _rounded(value, min(max(digits, 2), 8))


def _rounded(value: float, digits: int) -> str:
    """Round to significant digits; zeros replace a small power of ten."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+0" in text and abs(value) < 1e5 else _short(text)


def share_of(half_width: float, value: float) -> str:
    """Half an interval in percent of the estimate; more than 100 if the interval includes zero."""
    return "> 100" if half_width > abs(value) else f"{100 * half_width / abs(value):.2g}" if value else "0"


def percent(fit: float) -> str:
    """A fit in percent; not a number where the measured output is constant, infinite after a run that diverged."""
    return f"{fit:.1f} %" if isfinite(fit) else "none (constant output)" if isnan(fit) else "none (diverged)"


def capital(text: str) -> str:
    """A word with a capital letter; a symbol or an abbreviation such as y1, mVel or vir unchanged."""
    return text.capitalize() if text.islower() and text.isalpha() and len(text) > 3 else text


def first_up(text: str) -> str:
    """A text that begins with a capital letter."""
    return text[:1].upper() + text[1:]


def prefixed(size: float, unit: str) -> tuple[float, str]:
    """A factor and a prefixed unit in which a quantity of this size is between 1 and 1000."""
    for power, prefix in ((0, ""), (-3, "m"), (-6, "µ")):
        if size >= 10.0**power or not size:
            return 10.0**-power, f"{prefix}{unit}"
    return 1e9, f"n{unit}"


def sentence(text: str) -> str:
    """A message with a full stop and a capital, unless it begins with the name of a parameter.

    >>> sentence("the search stalled"), sentence("sensor.lag is fixed"), sentence("b1 is fixed.")
    ('The search stalled.', 'sensor.lag is fixed.', 'b1 is fixed.')
    """
    if not text:
        return ""
    first = text.split(maxsplit=1)[0]
    named = re.search(r"[_0-9]|[.].", first)
    return f"{text[:1] if named else text[:1].upper()}{text[1:].rstrip('.')}."


def within(value: float, half_width: float) -> str:
    """An estimate and half its interval, with significant digits only.

    >>> within(179.8, 1702.0), within(0.05000192, 9.4e-06), within(3.2e7, 1.1e6)
    ('less than 1900', '0.0500019 ± 9.4e-6', '3.2e7 ± 1.1e6')
    """
    return less_than(value, half_width) or f"{estimate(value, half_width)} ± {_rounded(half_width, 2)}"


def less_than(value: float, half_width: float | None) -> str:
    """The size that a value does not exceed, where its interval includes zero; empty for another value.

    >>> less_than(0.0005, 0.0022), less_than(-0.5, 0.2), less_than(0.5, None)
    ('less than 0.0027', '', '')
    """
    if half_width is None or not isfinite(half_width) or half_width <= abs(value):
        return ""
    return f"less than {_rounded(abs(value) + half_width, 2)}"


def slug(text: str) -> str:
    """A name for files and for places in a page.

    >>> slug("Wiener–Hammerstein (no. 2)")
    'wiener-hammerstein-no-2'
    """
    return "-".join(re.findall("[a-z0-9]+", text.lower())) or "model"


def tick(value: float) -> str:
    """The label of a tick in at most eight digits, as a power of ten from a million on.

    >>> tick(-0.5), tick(2e-6), tick(3e7), tick(0.1 + 0.2), tick(20000.0), tick(12345678.0)
    ('−0.5', '2e−6', '3e7', '0.3', '20000', '1.2345678e7')
    """
    digits = f"{value:.8g}" if abs(value) < 1e6 else re.sub(r"\.?0+e", "e", f"{value:.7e}")
    return _short(digits).replace("-", "−")


def both_directions(rows: Iterable[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Rows whose first cell is a name; those that are equal forward and backward are one.

    >>> both_directions([("level forward", "1"), ("level backward", "1"), ("zone forward", "2")])
    [('level, both directions', '1'), ('zone forward', '2')]
    """
    joined: dict[tuple[str, ...], tuple[str, ...]] = {}
    for name, *rest in rows:
        key = (name.replace(" backward", " forward"), *rest)
        joined[key] = (name.replace(" backward", ", both directions") if key in joined else name, *rest)
    return list(joined.values())
