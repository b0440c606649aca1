"""Whether the recommended model is the best one on another kind of input: ``python bench/choice.py 0-19``.

Random systems of many kinds (``tests/independent/assorted.py``, by number) give a record each. ``emsid.identify``
chooses among the default models; then all of them run freely over a record of another kind of input. The table has the
error of the recommended model over the smallest error there, for these choices among the same models:

- recommended: as `emsid.identify` recommends, with the parameters that its errors are from, or from all data (``all``);
- folds: the smallest error over the parts of the data that were left out in turn;
- last part: the smallest error on the part that was held back from the fits.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

import emsid
from arguments import numbers, parser_of

HOME = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HOME / "tests"))
from independent.assorted import Pair, pair  # noqa: E402

WAYS = ("recommended", "all", "folds", "last part")


def errors(models: Sequence[emsid.Model], unseen: emsid.Record) -> list[float]:
    """The RMSE of the free run of every model, all on the same samples."""
    start = max(model.memory for model in models)
    rows = [emsid.compare(model, unseen, transient=start).rows[0] for model in models]
    return [float(np.sqrt(row.ranked_by)) for row in rows]


def ratios(case: Pair) -> tuple[dict[str, float], str, str]:
    """The error of every choice over the smallest error, the recommended model and the best one."""
    result = emsid.identify(case.fitted)
    models = [fit.model for fit in result.fits]
    *of_each, of_all = errors([*models, result.recommended], case.unseen)
    found = dict(zip((model.name for model in models), of_each, strict=True))
    best = min(found, key=found.__getitem__)
    ranking = result.ranking
    last = min(result.on_unseen.rows, key=lambda row: row.ranked_by)
    chosen = {"recommended": result.chosen.model.name, "folds": ranking[0].name, "last part": last.model}
    answer = {way: found[name] / found[best] for way, name in chosen.items()}
    answer["all"] = of_all / found[best]
    return answer, chosen["recommended"], best


def main() -> None:
    """Print a line for each system, and the distributions of the ratios."""
    parser = parser_of(__doc__)
    parser.add_argument("systems", nargs="?", type=numbers, default="0-19", help="their numbers (default: 0-19)")
    systems = parser.parse_args().systems
    console = Console(width=150)
    found: dict[str, list[float]] = {way: [] for way in WAYS}
    for seed in systems:
        case = pair(seed)
        answer, chosen, best = ratios(case)
        shown = "  ".join(f"{way} {answer[way]:.3f}" for way in WAYS)
        console.print(f"{seed} {case.kind}, {len(case.fitted):,} samples: {shown}; {chosen}, best {best}")
        for way in WAYS:
            found[way].append(answer[way])
    for way, values in found.items():
        several = np.array(values)
        console.print(
            f"{way:12} geometric mean {np.exp(np.mean(np.log(several))):.3f}, median {np.median(several):.3f}, "
            f"nine tenths below {np.quantile(several, 0.9):.2f}, worst {several.max():.2f}; "
            f"at most 1.05 in {np.sum(several <= 1.05)}, at most 2 in {np.sum(several <= 2)} of {len(several)}"
        )


if __name__ == "__main__":
    main()
