"""An example of every finding, in each of its forms; `test_wording.py` pins the sentences that they make."""

from emsid.findings import Finding
from finding_examples import designs, fleets, models, records, results, study, verdicts

EXAMPLES: tuple[Finding, ...] = (
    *models.EXAMPLES,
    *results.EXAMPLES,
    *verdicts.EXAMPLES,
    *records.EXAMPLES,
    *study.EXAMPLES,
    *fleets.EXAMPLES,
    *designs.EXAMPLES,
)
