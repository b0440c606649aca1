"""Options, records and a reader of pages that several tests of the command line share."""

from html.parser import HTMLParser
from pathlib import Path

import numpy as np

IDENTIFY = ("--input", "u", "--output", "y", "--dt", "0.01")
FIRST_ORDER = ("--na", 1, "--nb", 1, "--nk", 1)  # so that none is chosen
MOTOR = ("--input", "voltage", "--output", "speed", "--time", "t")


def table(path: Path, samples: int = 600, seed: int = 0, **columns: object) -> Path:
    """A CSV with input u and the output y of a first-order system."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-2, 2, samples // 10), 10)
    y = np.zeros(samples)
    for t in range(1, samples):
        y[t] = 0.9 * y[t - 1] + 0.3 * u[t - 1]
    data = {"u": u, "y": y, **columns}
    rows = [",".join(data), *(",".join(str(values[t]) for values in data.values()) for t in range(samples))]
    path.write_text("\n".join(rows) + "\n")
    return path


class Page(HTMLParser):
    """A page, refused where its elements do not close."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: object) -> None:
        if tag not in {"meta", "br", "wbr", "link", "img", "hr", "input"}:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
