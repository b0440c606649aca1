"""What a page says about an identification."""

from __future__ import annotations

from emsid.identification.result import Identification
from emsid.record import Record
from emsid.report import views
from emsid.report.document import Fact, Report, Section
from emsid.report.numbers import percent
from emsid.wording import sentence


def report(result: Identification) -> Report:
    """What a page says about the result."""
    best, unit = result.on_unseen.best, result.unseen.output_units[0]
    linear_first = sorted(result.on_unseen.assessments, key=lambda each: each.row.model != "arx")
    intervals = views.critical_intervals(
        result.unseen, _stretch(result.unseen), result.unseen.output - linear_first[0].simulation.output
    )
    return Report(
        title=f"Identification of {result.record.name}",
        summary=tuple(sentence(finding) for finding in result.findings),
        facts=(
            Fact(best.row.model, "the best of the models in free run"),
            Fact(percent(best.row.fit_percent), f"fit of its free run on {result.ranked_on}"),
            Fact(f"{len(result.record):,}", "samples that the models were fitted to"),
            Fact(f"{best.row.samples:,}", "samples that they were ranked on"),
        ),
        sections=(
            Section(
                "Which model",
                tables=(
                    views.results_table(
                        result.on_unseen.rows, unit=unit, caption=f"On {result.ranked_on}, {result.unseen.name}."
                    ),
                    views.results_table(
                        result.on_record.rows, unit=unit, caption="On the data that the models were fitted to."
                    ),
                ),
                figures=(views.ranking(result.on_unseen),),
            ),
            Section(
                f"Free run on {result.ranked_on}",
                figures=(
                    views.measured_and_simulated(best),
                    views.responses(linear_first, intervals),
                    views.residuals(linear_first),
                ),
            ),
            Section("The data", figures=(views.inputs((result.record, result.unseen)),)),
            *(
                views.model_section(fit, result.record, profiles=result.profiles.get(fit.model.name, ()))
                for fit in result.fits
            ),
        ),
        imprint=f"emsid, from {result.record}",
    )


def _stretch(record: Record) -> float:
    """How many seconds of a record a figure of details shows: a tenth, but at least 50 samples."""
    return max(len(record) // 10, 50) * record.dt
